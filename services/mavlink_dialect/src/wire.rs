//! What verifying and routing need to know of each message of the dialect ardupilotmega, spoken here or not.

/// What of a message is needed to verify and route its frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wire {
    /// Seed of its checksum (MAVLink developer guide, "CRC_EXTRA").
    pub extra_crc: u8,
    /// Where in its payload the addressed system stands, if it names one (bytes).
    target_system_at: u8,
    /// The same for the addressed component.
    target_component_at: u8,
}

impl Wire {
    /// That of a message of the dialect; `None` for others.
    pub fn of(message_id: u32) -> Option<Self> {
        let at = MESSAGES.binary_search_by_key(&message_id, |row| row.0).ok()?;
        let (_, extra_crc, target_system_at, target_component_at) = MESSAGES[at];
        Some(Self {
            extra_crc,
            target_system_at,
            target_component_at,
        })
    }

    /// The addressed system and component in a payload, whose trailing zeros may have been cut; 0 = all.
    pub fn target(&self, payload: &[u8]) -> (u8, u8) {
        let byte = |at: u8| payload.get(usize::from(at)).copied().filter(|_| at != NONE);
        (
            byte(self.target_system_at).unwrap_or(0),
            byte(self.target_component_at).unwrap_or(0),
        )
    }
}

/// The message has no such field.
const NONE: u8 = 255;

/// By rising number: number, seed of the checksum, places of the addressed system and component. Computed from the definitions of
/// the MAVLink project as of the crate mavlink 0.21.
#[rustfmt::skip]
const MESSAGES: &[(u32, u8, u8, u8)] = &[
    (0, 50, NONE, NONE), (1, 124, NONE, NONE), (2, 137, NONE, NONE), (4, 237, 12, 13), (5, 217, 0, NONE),
    (6, 104, NONE, NONE), (7, 119, NONE, NONE), (8, 117, NONE, NONE), (11, 89, 4, NONE), (20, 214, 2, 3),
    (21, 159, 0, 1), (22, 220, NONE, NONE), (23, 168, 4, 5), (24, 24, NONE, NONE), (25, 23, NONE, NONE),
    (26, 170, NONE, NONE), (27, 144, NONE, NONE), (28, 67, NONE, NONE), (29, 115, NONE, NONE), (30, 39, NONE, NONE),
    (31, 246, NONE, NONE), (32, 185, NONE, NONE), (33, 104, NONE, NONE), (34, 237, NONE, NONE), (35, 244, NONE, NONE),
    (36, 222, NONE, NONE), (37, 212, 4, 5), (38, 9, 4, 5), (39, 254, 32, 33), (40, 230, 2, 3), (41, 28, 2, 3),
    (42, 28, NONE, NONE), (43, 132, 0, 1), (44, 221, 2, 3), (45, 232, 0, 1), (46, 11, NONE, NONE), (47, 153, 0, 1),
    (48, 41, 12, NONE), (49, 39, NONE, NONE), (50, 78, 18, 19), (51, 196, 2, 3), (54, 15, 24, 25),
    (55, 3, NONE, NONE), (61, 167, NONE, NONE), (62, 183, NONE, NONE), (63, 119, NONE, NONE), (64, 191, NONE, NONE),
    (65, 118, NONE, NONE), (66, 148, 2, 3), (67, 21, NONE, NONE), (69, 243, 10, NONE), (70, 124, 16, 17),
    (73, 38, 32, 33), (74, 20, NONE, NONE), (75, 158, 30, 31), (76, 152, 30, 31), (77, 143, 8, 9), (80, 14, 2, 3),
    (81, 106, NONE, NONE), (82, 49, 36, 37), (83, 22, NONE, NONE), (84, 143, 50, 51), (85, 140, NONE, NONE),
    (86, 5, 50, 51), (87, 150, NONE, NONE), (89, 231, NONE, NONE), (90, 183, NONE, NONE), (91, 63, NONE, NONE),
    (92, 54, NONE, NONE), (93, 47, NONE, NONE), (100, 175, NONE, NONE), (101, 102, NONE, NONE),
    (102, 158, NONE, NONE), (103, 208, NONE, NONE), (104, 56, NONE, NONE), (105, 93, NONE, NONE),
    (106, 138, NONE, NONE), (107, 108, NONE, NONE), (108, 32, NONE, NONE), (109, 185, NONE, NONE), (110, 84, 1, 2),
    (111, 34, 16, 17), (112, 174, NONE, NONE), (113, 124, NONE, NONE), (114, 237, NONE, NONE), (115, 4, NONE, NONE),
    (116, 76, NONE, NONE), (117, 128, 4, 5), (118, 56, NONE, NONE), (119, 116, 10, 11), (120, 134, NONE, NONE),
    (121, 237, 0, 1), (122, 203, 0, 1), (123, 250, 0, 1), (124, 87, NONE, NONE), (125, 203, NONE, NONE),
    (126, 220, 79, 80), (127, 25, NONE, NONE), (128, 226, NONE, NONE), (129, 46, NONE, NONE), (130, 29, NONE, NONE),
    (131, 223, NONE, NONE), (132, 85, NONE, NONE), (133, 6, NONE, NONE), (134, 229, NONE, NONE),
    (135, 203, NONE, NONE), (136, 1, NONE, NONE), (137, 195, NONE, NONE), (138, 109, NONE, NONE), (139, 168, 41, 42),
    (140, 181, NONE, NONE), (141, 47, NONE, NONE), (142, 72, NONE, NONE), (143, 131, NONE, NONE),
    (144, 127, NONE, NONE), (146, 103, NONE, NONE), (147, 154, NONE, NONE), (148, 178, NONE, NONE),
    (149, 200, NONE, NONE), (150, 134, NONE, NONE), (151, 219, 6, 7), (152, 208, NONE, NONE), (153, 188, NONE, NONE),
    (154, 84, 6, 7), (155, 22, 4, 5), (156, 19, 0, 1), (157, 21, 12, 13), (158, 134, 12, 13), (160, 78, 8, 9),
    (161, 68, 0, 1), (162, 189, NONE, NONE), (163, 127, NONE, NONE), (164, 154, NONE, NONE), (165, 21, NONE, NONE),
    (166, 21, NONE, NONE), (167, 144, NONE, NONE), (168, 1, NONE, NONE), (169, 234, NONE, NONE),
    (170, 73, NONE, NONE), (171, 181, NONE, NONE), (172, 22, NONE, NONE), (173, 83, NONE, NONE),
    (174, 167, NONE, NONE), (175, 138, 14, 15), (176, 234, 0, 1), (177, 240, NONE, NONE), (178, 47, NONE, NONE),
    (179, 189, 26, NONE), (180, 52, 42, NONE), (181, 174, NONE, NONE), (182, 229, NONE, NONE), (183, 85, 0, 1),
    (184, 159, 4, 5), (185, 186, 4, 5), (186, 72, 0, 1), (191, 92, NONE, NONE), (192, 36, NONE, NONE),
    (193, 71, NONE, NONE), (194, 98, NONE, NONE), (195, 120, NONE, NONE), (200, 134, 40, 41), (201, 205, 12, 13),
    (214, 69, 6, 7), (215, 101, NONE, NONE), (216, 50, 0, 1), (217, 202, NONE, NONE), (218, 17, 0, 1),
    (219, 162, NONE, NONE), (225, 208, NONE, NONE), (226, 207, NONE, NONE), (230, 163, NONE, NONE),
    (231, 105, NONE, NONE), (232, 151, NONE, NONE), (233, 35, NONE, NONE), (234, 150, NONE, NONE),
    (235, 179, NONE, NONE), (241, 90, NONE, NONE), (242, 104, NONE, NONE), (243, 85, 52, NONE), (244, 95, NONE, NONE),
    (245, 130, NONE, NONE), (246, 184, NONE, NONE), (247, 81, NONE, NONE), (248, 8, 3, 4), (249, 204, NONE, NONE),
    (250, 49, NONE, NONE), (251, 170, NONE, NONE), (252, 44, NONE, NONE), (253, 83, NONE, NONE),
    (254, 46, NONE, NONE), (256, 71, 8, 9), (257, 131, NONE, NONE), (258, 187, 0, 1), (259, 92, NONE, NONE),
    (260, 146, NONE, NONE), (261, 179, NONE, NONE), (262, 12, NONE, NONE), (263, 133, NONE, NONE),
    (264, 49, NONE, NONE), (265, 26, NONE, NONE), (266, 193, 2, 3), (267, 35, 2, 3), (268, 14, 2, 3),
    (269, 109, NONE, NONE), (270, 59, NONE, NONE), (271, 22, NONE, NONE), (275, 126, NONE, NONE),
    (276, 18, NONE, NONE), (277, 62, NONE, NONE), (280, 70, NONE, NONE), (281, 48, NONE, NONE), (282, 123, 32, 33),
    (283, 74, NONE, NONE), (284, 99, 30, 31), (285, 137, 38, 39), (286, 210, 50, 51), (287, 1, 20, 21),
    (288, 20, 20, 21), (290, 251, NONE, NONE), (291, 10, NONE, NONE), (295, 234, NONE, NONE), (296, 158, 36, 37),
    (299, 19, NONE, NONE), (300, 217, NONE, NONE), (301, 243, NONE, NONE), (310, 28, NONE, NONE),
    (311, 95, NONE, NONE), (320, 243, 2, 3), (321, 88, 0, 1), (322, 243, NONE, NONE), (323, 78, 0, 1),
    (324, 132, NONE, NONE), (330, 23, NONE, NONE), (331, 91, NONE, NONE), (332, 236, NONE, NONE),
    (333, 231, NONE, NONE), (334, 72, NONE, NONE), (335, 225, NONE, NONE), (336, 245, NONE, NONE),
    (339, 199, NONE, NONE), (340, 99, NONE, NONE), (345, 209, 2, 3), (350, 232, NONE, NONE), (360, 11, NONE, NONE),
    (361, 93, NONE, NONE), (370, 75, NONE, NONE), (371, 10, NONE, NONE), (372, 26, NONE, NONE),
    (373, 117, NONE, NONE), (375, 251, NONE, NONE), (376, 199, NONE, NONE), (380, 232, NONE, NONE), (385, 147, 2, 3),
    (386, 132, 4, 5), (387, 4, 4, 5), (388, 8, 32, 33), (390, 156, NONE, NONE), (395, 0, NONE, NONE),
    (396, 50, NONE, NONE), (397, 182, NONE, NONE), (400, 110, 4, 5), (401, 183, 4, 5), (410, 160, NONE, NONE),
    (411, 106, NONE, NONE), (412, 33, 4, 5), (413, 77, 4, 5), (435, 134, NONE, NONE), (436, 193, NONE, NONE),
    (437, 30, NONE, NONE), (440, 66, NONE, NONE), (9000, 113, NONE, NONE), (9005, 117, NONE, NONE),
    (10001, 209, NONE, NONE), (10002, 186, NONE, NONE), (10003, 4, NONE, NONE), (10004, 133, NONE, NONE),
    (10005, 103, NONE, NONE), (10006, 193, NONE, NONE), (10007, 71, NONE, NONE), (10008, 240, NONE, NONE),
    (10151, 195, NONE, NONE), (11000, 134, 4, 5), (11001, 15, NONE, NONE), (11002, 234, 4, 5),
    (11003, 64, NONE, NONE), (11004, 11, 8, 9), (11005, 93, NONE, NONE), (11010, 46, NONE, NONE),
    (11011, 106, NONE, NONE), (11020, 205, NONE, NONE), (11030, 144, NONE, NONE), (11031, 133, NONE, NONE),
    (11032, 85, NONE, NONE), (11033, 195, 16, 17), (11034, 79, NONE, NONE), (11035, 128, 4, 5),
    (11036, 177, NONE, NONE), (11037, 130, NONE, NONE), (11038, 47, NONE, NONE), (11039, 142, NONE, NONE),
    (11040, 132, NONE, NONE), (11041, 208, NONE, NONE), (11042, 201, NONE, NONE), (11043, 193, NONE, NONE),
    (11044, 189, NONE, NONE), (11060, 162, NONE, NONE), (12900, 114, 0, 1), (12901, 254, 30, 31), (12902, 140, 4, 5),
    (12903, 249, 0, 1), (12904, 77, 28, 29), (12905, 49, 0, 1), (12915, 94, 0, 1), (12918, 139, NONE, NONE),
    (12919, 7, 16, 17), (12920, 20, NONE, NONE), (42000, 227, NONE, NONE), (42001, 239, NONE, NONE),
    (50001, 246, NONE, NONE), (50002, 181, NONE, NONE), (50003, 62, NONE, NONE), (50004, 240, 8, 9),
    (50005, 152, 4, 5), (52000, 13, NONE, NONE), (52001, 239, NONE, NONE),
];

#[cfg(test)]
mod tests {
    use super::{MESSAGES, Wire};
    use crate::dialect::MavMessage;
    use crate::{MavlinkVersion, Message};

    #[test]
    fn what_is_spoken_is_verified_and_addressed_as_its_definition_says() {
        let ids = || MESSAGES.iter().map(|row| row.0);
        assert!(ids().is_sorted_by(|one, next| one < next));
        let mut spoken = 0;
        for id in 0..70_000 {
            let Some(mut message) = MavMessage::default_message_from_id(id) else {
                continue;
            };
            spoken += 1;
            let wire = Wire::of(id).unwrap();
            assert_eq!(
                wire.extra_crc,
                MavMessage::extra_crc(id),
                "{}",
                message.message_name()
            );
            let system = message
                .target_system_id_mut()
                .map(|system| *system = 17)
                .is_some();
            let component = message
                .target_component_id_mut()
                .map(|component| *component = 23)
                .is_some();
            let mut payload = [0; 255];
            let len = message.ser(MavlinkVersion::V2, &mut payload);
            let expected = (if system { 17 } else { 0 }, if component { 23 } else { 0 });
            assert_eq!(
                wire.target(&payload[..len]),
                expected,
                "{}",
                message.message_name()
            );
        }
        assert!(spoken > 50 && spoken < ids().count());
    }
}
