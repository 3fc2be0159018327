//! ONBOARD_COMPUTER_STATUS of component 191: how the board is doing.
//!
//! What is not known is said to be unknown, in the way of each field; zero would be a measurement.

use jink_shared_types::Timestamp;
use mavlink::dialect::{ComputerStatusFlags, MavMessage, ONBOARD_COMPUTER_STATUS_DATA};

/// Unknown, of fields with four bytes.
pub const UNKNOWN_U32: u32 = u32::MAX;
/// Unknown share of a processor.
pub const UNKNOWN_SHARE: u8 = u8::MAX;
/// Unknown temperature.
pub const UNKNOWN_TEMPERATURE: i8 = i8::MAX;
/// Processors that can be distinguished.
pub const CORES: usize = 8;
/// Slices of 100 ms in a second.
pub const SLICES: usize = 10;
/// Links that can be distinguished.
pub const LINKS: usize = 6;

/// Traffic of one network interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LinkLoad {
    /// 10 = wired, 20 = wireless.
    pub kind: u32,
    /// Sent (KiB/s).
    pub sent_kibps: u32,
    /// Received (KiB/s).
    pub received_kibps: u32,
}

/// The board as it was read last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BoardReading {
    /// Since the board was switched on (ms).
    pub uptime_ms: u32,
    /// Load of each processor within the last second (%).
    pub cores_pct: [u8; CORES],
    /// Load of all of them in slices of 100 ms, oldest first (%).
    pub slices_pct: [u8; SLICES],
    /// Memory in use (MiB).
    pub ram_used_mib: u32,
    /// Memory (MiB).
    pub ram_total_mib: u32,
    /// Space in use on the file system of the root (MiB).
    pub storage_used_mib: u32,
    /// Space there (MiB).
    pub storage_total_mib: u32,
    /// Temperature (degrees Celsius).
    pub temperature_c: i8,
    /// Network interfaces.
    pub links: [Option<LinkLoad>; LINKS],
}

impl Default for BoardReading {
    fn default() -> Self {
        Self {
            uptime_ms: 0,
            cores_pct: [UNKNOWN_SHARE; CORES],
            slices_pct: [UNKNOWN_SHARE; SLICES],
            ram_used_mib: UNKNOWN_U32,
            ram_total_mib: UNKNOWN_U32,
            storage_used_mib: UNKNOWN_U32,
            storage_total_mib: UNKNOWN_U32,
            temperature_c: UNKNOWN_TEMPERATURE,
            links: [None; LINKS],
        }
    }
}

/// The message that says so at `now`.
pub fn message(now: Timestamp, board: &BoardReading) -> MavMessage {
    let one = |value: u32| [value, UNKNOWN_U32, UNKNOWN_U32, UNKNOWN_U32];
    let of_links =
        |field: fn(&LinkLoad) -> u32| board.links.map(|link| link.as_ref().map_or(UNKNOWN_U32, field));
    MavMessage::ONBOARD_COMPUTER_STATUS(ONBOARD_COMPUTER_STATUS_DATA {
        time_usec: now.ns / 1000,
        uptime: board.uptime_ms,
        ram_usage: board.ram_used_mib,
        ram_total: board.ram_total_mib,
        storage_type: [UNKNOWN_U32; 4],
        storage_usage: one(board.storage_used_mib),
        storage_total: one(board.storage_total_mib),
        link_type: of_links(|link| link.kind),
        link_tx_rate: of_links(|link| link.sent_kibps),
        link_rx_rate: of_links(|link| link.received_kibps),
        link_tx_max: [UNKNOWN_U32; LINKS],
        link_rx_max: [UNKNOWN_U32; LINKS],
        fan_speed: [i16::MAX; 4],
        // The primary mission computer.
        mavtype: 0,
        cpu_cores: board.cores_pct,
        cpu_combined: board.slices_pct,
        gpu_cores: [UNKNOWN_SHARE; 4],
        gpu_combined: [UNKNOWN_SHARE; SLICES],
        temperature_board: board.temperature_c,
        temperature_core: [UNKNOWN_TEMPERATURE; CORES],
        status_flags: ComputerStatusFlags::empty(),
    })
}

#[cfg(test)]
mod tests {
    use super::{BoardReading, LinkLoad, UNKNOWN_U32, message};
    use jink_shared_types::Timestamp;
    use mavlink::dialect::{MavMessage, ONBOARD_COMPUTER_STATUS_DATA};

    fn said(board: &BoardReading) -> ONBOARD_COMPUTER_STATUS_DATA {
        match message(Timestamp::from_seconds(2.0), board) {
            MavMessage::ONBOARD_COMPUTER_STATUS(data) => data,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn what_is_not_known_is_not_reported_as_zero() {
        let data = said(&BoardReading::default());
        assert_eq!((data.cpu_cores, data.cpu_combined), ([255; 8], [255; 10]));
        assert_eq!((data.gpu_cores, data.gpu_combined), ([255; 4], [255; 10]));
        assert_eq!((data.temperature_board, data.temperature_core), (127, [127; 8]));
        assert_eq!((data.ram_usage, data.ram_total), (UNKNOWN_U32, UNKNOWN_U32));
        assert_eq!(
            (data.storage_usage, data.fan_speed),
            ([UNKNOWN_U32; 4], [i16::MAX; 4])
        );
        assert_eq!(
            (data.link_type, data.link_tx_rate),
            ([UNKNOWN_U32; 6], [UNKNOWN_U32; 6])
        );
    }

    #[test]
    fn what_is_known_is_reported() {
        let mut board = BoardReading {
            uptime_ms: 5,
            temperature_c: 61,
            ..BoardReading::default()
        };
        board.links[1] = Some(LinkLoad {
            kind: 20,
            sent_kibps: 12,
            received_kibps: 3,
        });
        let data = said(&board);
        assert_eq!(
            (data.uptime, data.temperature_board, data.time_usec),
            (5, 61, 2_000_000)
        );
        assert_eq!(
            (data.link_type[1], data.link_tx_rate[1], data.link_rx_rate[1]),
            (20, 12, 3)
        );
    }
}
