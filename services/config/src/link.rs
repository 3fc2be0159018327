//! `[link]` and `[[link.also]]`: where the autopilot is, and who else is connected.
//!
//! | table | link | its name |
//! |---|---|---|
//! | `[link]` | the autopilot's | `autopilot` |
//! | `[[link.also]]` | one more each: a ground station, a camera, a second way to the autopilot | its own |

use super::ConfigError;
use jink_shared_types::link::LINKS;
use serde::Deserialize;
use std::net::IpAddr;
use toml::Spanned;

/// What the autopilot's link is called in logs and events.
pub const AUTOPILOT_LINK: &str = "autopilot";

/// Longest name of a link: an event's line has fifty bytes.
const NAME_MAX: usize = 15;

/// The link to the autopilot, and what concerns all links.
#[derive(Clone, Debug, Deserialize, PartialEq, Eq)]
#[serde(deny_unknown_fields, default)]
pub struct Link {
    /// `udpin:ADDRESS:PORT`, `udpout:ADDRESS:PORT`, `tcpin:...`, `tcpout:...`, `serial:DEVICE:BAUD` or `unix:PATH`.
    pub address: String,
    /// How setpoints are sent: `px4_trajectory`, `px4_offboard`, `px4_deviation` or `ardupilot_guided`; `auto` = the
    /// one that is for the autopilot on the link.
    pub profile: String,
    /// The message that `px4_trajectory` sends: `bezier` or `waypoints`.
    pub output: String,
    /// Missions that the autopilot flies are taken over, where it only follows setpoints.
    pub takes_missions: bool,
    /// Folder for telemetry logs of everything on the links; empty = none.
    pub tlog: String,
    /// What the telemetry logs of that folder may take (MB); 0 = as much as there is.
    pub tlog_max_mb: u32,
    /// Folder for what must outlive a restart (the stamps of signatures); empty = the instance's own, in memory.
    pub state: String,
    /// The vehicle's system id; 0 = that of the only autopilot seen.
    pub system_id: u8,
    /// What is asked of the signatures of messages.
    pub signing: Signing,
    /// The file with the key.
    pub key_file: String,
    /// The number of this link in its signatures.
    pub link_id: u8,
    /// From whom messages are accepted on a listening link; empty = everybody.
    pub peers: Vec<IpAddr>,
    /// What the link carries (bytes/s); 0 = a serial port's speed, or no limit.
    pub bytes_per_s: u32,
    /// Further links.
    pub also: Vec<AlsoLink>,
}

impl Default for Link {
    fn default() -> Self {
        Self {
            address: "udpin:127.0.0.1:14540".to_owned(),
            profile: "auto".to_owned(),
            output: "bezier".to_owned(),
            takes_missions: true,
            tlog: String::new(),
            tlog_max_mb: 1000,
            state: String::new(),
            system_id: 0,
            signing: Signing::Off,
            key_file: String::new(),
            link_id: 0,
            peers: Vec::new(),
            bytes_per_s: 0,
            also: Vec::new(),
        }
    }
}

/// One link besides the autopilot's. The keys that `[link]` has as well mean the same.
#[derive(Clone, Debug, Deserialize, PartialEq, Eq)]
#[serde(deny_unknown_fields)]
pub struct AlsoLink {
    /// Its name in logs and events.
    pub name: Spanned<String>,
    /// As in `[link]`.
    pub address: String,
    /// Who is at its other end.
    #[serde(default)]
    pub purpose: Purpose,
    /// As in `[link]`.
    #[serde(default)]
    pub signing: Signing,
    /// As in `[link]`.
    #[serde(default)]
    pub key_file: String,
    /// As in `[link]`.
    #[serde(default)]
    pub link_id: u8,
    /// As in `[link]`.
    #[serde(default)]
    pub peers: Vec<IpAddr>,
    /// As in `[link]`.
    #[serde(default)]
    pub bytes_per_s: u32,
}

/// Who is at the other end of a link.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub enum Purpose {
    /// Ground stations and other components: whoever sends there is never taken for our autopilot.
    #[default]
    GroundStation,
    /// The autopilot, too: accepted there when it is silent on the link where it was seen before.
    Autopilot,
}

/// What is asked of the signatures of messages (MAVLink 2).
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
pub enum Signing {
    /// Nothing: signatures are not looked at, and ours are not made.
    #[default]
    Off,
    /// What is signed must be signed with the key; what is not signed is taken, too. We sign.
    Accept,
    /// What is not signed is refused, RADIO_STATUS excepted. We sign.
    Require,
}

/// One link, wherever it stands in the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LinkRow {
    /// Its table, as errors name it.
    pub table: String,
    /// Its name.
    pub name: String,
    /// Its address.
    pub address: String,
    /// Who is at its other end.
    pub purpose: Purpose,
    /// What is asked of signatures.
    pub signing: Signing,
    /// The file with the key.
    pub key_file: String,
    /// Its number in signatures.
    pub link_id: u8,
    /// From whom messages are accepted.
    pub peers: Vec<IpAddr>,
    /// What it carries (bytes/s); 0 = not given.
    pub bytes_per_s: u32,
}

impl Link {
    /// Every link, the autopilot's first.
    pub fn rows(&self) -> Vec<LinkRow> {
        let first = LinkRow {
            table: "link".to_owned(),
            name: AUTOPILOT_LINK.to_owned(),
            address: self.address.clone(),
            purpose: Purpose::Autopilot,
            signing: self.signing,
            key_file: self.key_file.clone(),
            link_id: self.link_id,
            peers: self.peers.clone(),
            bytes_per_s: self.bytes_per_s,
        };
        let others = self.also.iter().map(|also| LinkRow {
            table: format!("link.also {:?}", also.name.get_ref()),
            name: also.name.get_ref().clone(),
            address: also.address.clone(),
            purpose: also.purpose,
            signing: also.signing,
            key_file: also.key_file.clone(),
            link_id: also.link_id,
            peers: also.peers.clone(),
            bytes_per_s: also.bytes_per_s,
        });
        std::iter::once(first).chain(others).collect()
    }

    /// What serde cannot see: names that are taken, links too many.
    pub(super) fn check(&self, at: &impl Fn(usize, String) -> ConfigError) -> Result<(), ConfigError> {
        let mut names = vec![AUTOPILOT_LINK];
        for also in &self.also {
            let name = also.name.get_ref();
            let refuse = |message| Err(at(also.name.span().start, message));
            let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
            if !(1..=NAME_MAX).contains(&name.len()) || !name.chars().all(plain) {
                return refuse(format!(
                    "link name {name:?}: use 1 to {NAME_MAX} lower-case letters, digits and underscores"
                ));
            }
            if names.contains(&name.as_str()) {
                return refuse(format!("two links are called {name:?}"));
            }
            if names.len() == LINKS {
                return refuse(format!("link {name:?} is one too many: {LINKS} links at most"));
            }
            names.push(name);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::{Purpose, Signing};
    use crate::Config;
    use std::path::Path;

    fn error_of(text: &str) -> String {
        Config::parse(Path::new("jink.toml"), text)
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn several_links_are_read_and_the_autopilots_comes_first() {
        let text = "[link]\naddress = \"serial:/dev/ttyTHS1:921600\"\n[[link.also]]\nname = \"ground\"\n\
                    address = \"udpin:0.0.0.0:14550\"\nsigning = \"require\"\nkey_file = \"/etc/jink/key\"\n\
                    link_id = 3\npeers = [\"10.41.1.1\", \"fe80::1\"]\nbytes_per_s = 2000\n";
        let rows = Config::parse(Path::new("jink.toml"), text).unwrap().link.rows();
        let names: Vec<_> = rows.iter().map(|row| row.name.as_str()).collect();
        assert_eq!(names, ["autopilot", "ground"]);
        assert_eq!(
            (rows[0].purpose, rows[0].signing),
            (Purpose::Autopilot, Signing::Off)
        );
        assert_eq!(
            (rows[1].purpose, rows[1].signing),
            (Purpose::GroundStation, Signing::Require)
        );
        assert_eq!(
            (rows[1].peers.len(), rows[1].link_id, rows[1].bytes_per_s),
            (2, 3, 2000)
        );
    }

    #[test]
    fn a_wrong_key_or_value_of_a_link_is_answered_with_the_nearest() {
        let link = |rest: &str| format!("[[link.also]]\nname = \"a\"\naddress = \"tcpin:1\"\n{rest}\n");
        assert_eq!(
            error_of(&link("signin = \"off\"")),
            "jink.toml:4: unknown key `signin`; did you mean `signing`?"
        );
        assert_eq!(
            error_of(&link("signing = \"requires\"")),
            "jink.toml:4: unknown value `requires`; did you mean `require`?"
        );
        assert_eq!(
            error_of("[link]\npeer = []\n"),
            "jink.toml:2: unknown key `peer`; did you mean `peers`?"
        );
        assert!(error_of(&link("peers = [\"10.41.1\"]")).starts_with("jink.toml:4: "));
        assert!(error_of("[[link.also]]\nname = \"a\"\n").contains("missing field `address`"));
    }

    #[test]
    fn links_have_names_of_their_own_and_are_four_at_most() {
        let also = |name: &str| format!("[[link.also]]\nname = \"{name}\"\naddress = \"tcpin:1\"\n");
        assert_eq!(
            error_of(&also("autopilot")),
            "jink.toml:2: two links are called \"autopilot\""
        );
        assert!(error_of(&also("The tower")).contains("use 1 to 15 lower-case letters"));
        let four: String = ["a", "b", "c", "d"].map(also).concat();
        assert_eq!(
            error_of(&four),
            "jink.toml:11: link \"d\" is one too many: 4 links at most"
        );
    }
}
