//! The link of a jink that runs, as its gateway sees it: as far as an examination goes that asks the autopilot nothing.

use jink_control::findings::{Finding, Grade, of_events};
use jink_control::status::unfit;
use jink_shared_types::events::{AUTOPILOT_LOST, EventSample, LINK_SLOW, MODE_REFUSED, SETPOINTS_IGNORED};
use jink_shared_types::link::{AvoidanceState, LinkStatus, LinkTraffic};

/// `vehicle/state` is stale after 100 ms: below this rate (Hz) its readers hold.
const STATE_RATE_MIN_HZ: f64 = 10.0;
/// Garbage in the time of looking that is more than a disturbance (bytes).
const GARBAGE_MAX: u64 = 300;

/// What was seen of a running gateway.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// Its figures at the begin, and at the end.
    pub figures: Option<(&'a LinkStatus, &'a LinkStatus)>,
    /// The time between (s).
    pub seconds: f64,
    /// Vehicle states in that time.
    pub states: u64,
    /// What was reported in that time.
    pub events: &'a [EventSample],
}

fn finding(grade: Grade, about: &str, is: String, remedy: &str) -> Finding {
    Finding {
        grade,
        about: about.to_owned(),
        is,
        remedy: remedy.to_owned(),
    }
}

/// What follows from it.
pub fn judge(seen: &Seen<'_>) -> Vec<Finding> {
    let Some((before, after)) = seen.figures else {
        return vec![finding(
            Grade::Blocker,
            "gateway",
            "the gateway gives no figures".to_owned(),
            "`jink status` shows what it does; its log stands beside the others (`jink status` names the folder)",
        )];
    };
    let mut findings = Vec::new();
    traffic(before, after, seen.seconds, &mut findings);
    if after.system_id != 0 && after.autopilot_alive.is_set() {
        flow(before, after, seen, &mut findings);
    }
    let about_link = [
        AUTOPILOT_LOST.id,
        LINK_SLOW.id,
        MODE_REFUSED.id,
        SETPOINTS_IGNORED.id,
    ];
    findings.extend(of_events(seen.events, &about_link));
    findings
}

/// Whether the autopilot is seen, and if not, why.
fn traffic(before: &LinkStatus, after: &LinkStatus, seconds: f64, findings: &mut Vec<Finding>) {
    let garbage = after.garbage_bytes.saturating_sub(before.garbage_bytes);
    let refused = |count: fn(&LinkTraffic) -> u64| after.links.iter().map(count).sum::<u64>();
    let received = after.received.saturating_sub(before.received);
    if refused(|link| link.signature_refused) + refused(|link| link.unsigned_refused) > 0 {
        findings.push(finding(
            Grade::Blocker,
            "signatures",
            format!(
                "messages are refused: {} signed with another key, {} not signed",
                refused(|link| link.signature_refused),
                refused(|link| link.unsigned_refused)
            ),
            "give both sides the same key (docs/links.md), or set link.signing to \"accept\" or \"off\"",
        ));
    }
    if garbage > GARBAGE_MAX && received == 0 {
        findings.push(finding(
            Grade::Blocker,
            "link",
            format!("{garbage} bytes came, but no message of the autopilot"),
            "on a serial line the speed is probably wrong: link.address must name that of the autopilot's port",
        ));
    } else if after.system_id == 0 && after.ignored > before.ignored {
        findings.push(finding(
            Grade::Blocker,
            "autopilot",
            "messages come, but not of one autopilot that is ours".to_owned(),
            "`jink down` and `jink check link` show who speaks there; two autopilots need link.system_id",
        ));
    } else if after.system_id == 0 || !after.autopilot_alive.is_set() {
        findings.push(finding(
            Grade::Blocker,
            "autopilot",
            "the autopilot is not connected".to_owned(),
            "check its power and the line; `jink down` and `jink check link` look closer",
        ));
    } else {
        findings.push(finding(
            Grade::Good,
            "autopilot",
            format!(
                "system {} is connected, {:.0} messages a second",
                after.system_id,
                received as f64 / seconds.max(0.1)
            ),
            "",
        ));
    }
}

/// Whether what is needed flows both ways.
fn flow(before: &LinkStatus, after: &LinkStatus, seen: &Seen<'_>, findings: &mut Vec<Finding>) {
    let seconds = seen.seconds.max(0.1);
    let state_hz = seen.states as f64 / seconds;
    let per_second = |now: u64, then: u64| now.saturating_sub(then) as f64 / seconds;
    if state_hz < STATE_RATE_MIN_HZ {
        findings.push(finding(
            Grade::Blocker,
            "vehicle/state",
            format!("the vehicle's state is known {state_hz:.0} times a second: positions or attitudes do not come often enough"),
            "wait for the autopilot's position; else give its port a higher speed (docs/connect_*.md)",
        ));
    } else {
        findings.push(finding(
            Grade::Good,
            "vehicle/state",
            format!("the vehicle's state is known {state_hz:.0} times a second"),
            "",
        ));
    }
    if after.timesync_converged.is_set() {
        findings.push(finding(
            Grade::Good,
            "TIMESYNC",
            format!(
                "clocks are synchronised, shortest round trip {:.1} ms{}",
                f64::from(after.round_trip_us) * 1e-3,
                match after.clock_rate_ppm {
                    0 => String::new(),
                    ppm => format!("; the autopilot's runs at {:.4}", 1.0 + f64::from(ppm) * 1e-6),
                }
            ),
            "",
        ));
    } else {
        findings.push(finding(
            Grade::Warning,
            "TIMESYNC",
            format!(
                "time is not synchronised: {} answers to TIMESYNC so far",
                after.timesync_samples
            ),
            "wait some seconds; if it stays so, let routers pass TIMESYNC on, and use a faster line",
        ));
    }
    match unfit(after) {
        Some([is, remedy]) => findings.push(finding(Grade::Blocker, "profile", is, &remedy)),
        None => findings.push(finding(
            Grade::Good,
            "profile",
            format!("profile {} fits the autopilot", after.profile.as_str()),
            "",
        )),
    }
    let setpoints_hz = per_second(after.setpoints, before.setpoints);
    let state = after.avoidance.get();
    findings.push(match state {
        AvoidanceState::Active => finding(
            Grade::Good,
            "avoidance",
            format!("component 196 says active; {setpoints_hz:.0} setpoints a second"),
            "",
        ),
        _ => finding(
            Grade::Warning,
            "avoidance",
            format!("component 196 says {state}; {setpoints_hz:.0} setpoints a second"),
            "`jink status` names what is missing",
        ),
    });
}

#[cfg(test)]
mod tests {
    use super::{Seen, judge};
    use jink_control::findings::Grade;
    use jink_shared_types::events::{EventSample, MODE_REFUSED};
    use jink_shared_types::health::Name;
    use jink_shared_types::link::{AvoidanceState, LinkStatus, ProfileFit};
    use jink_shared_types::{Coded, Flag};

    /// A gateway that has flown for a while.
    fn flying() -> LinkStatus {
        LinkStatus {
            received: 500,
            setpoints: 60,
            system_id: 1,
            autopilot_alive: Flag::from(true),
            timesync_converged: Flag::from(true),
            round_trip_us: 900,
            avoidance: Coded::new(AvoidanceState::Active),
            profile: Name::new("px4_offboard"),
            profile_fit: Coded::new(ProfileFit::Fits),
            ..LinkStatus::default()
        }
    }

    /// Grade and words of everything found in three seconds that ended so.
    fn found(after: &LinkStatus, states: u64, events: &[EventSample]) -> Vec<(Grade, String)> {
        let before = LinkStatus::default();
        let findings = judge(&Seen {
            figures: Some((&before, after)),
            seconds: 3.0,
            states,
            events,
        });
        findings.into_iter().map(|one| (one.grade, one.is)).collect()
    }

    #[test]
    fn a_flying_gateway_is_good_in_every_respect() {
        let found = found(&flying(), 150, &[]);
        assert_eq!(found.len(), 5);
        assert!(found.iter().all(|(grade, _)| *grade == Grade::Good), "{found:?}");
    }

    #[test]
    fn each_fault_is_reported_by_its_own_sentence() {
        let silent = LinkStatus::default();
        let noise = LinkStatus {
            garbage_bytes: 4000,
            ..silent
        };
        let unknown_peers = LinkStatus {
            ignored: 30,
            ..silent
        };
        let lost = LinkStatus {
            autopilot_alive: Flag::from(false),
            ..flying()
        };
        let mut keyless = flying();
        keyless.links[0].unsigned_refused = 9;
        let unsynchronised = LinkStatus {
            timesync_converged: Flag::from(false),
            ..flying()
        };
        let standby = LinkStatus {
            avoidance: Coded::new(AvoidanceState::Standby),
            ..flying()
        };
        let unfit = LinkStatus {
            profile_fit: Coded::new(ProfileFit::NoInterface),
            matching_profile: Name::new("px4_offboard"),
            profile: Name::new("px4_trajectory"),
            ..flying()
        };
        for (after, states, grade, words) in [
            (unfit, 150, Grade::Blocker, "lacks the interface of profile"),
            (silent, 0, Grade::Blocker, "the autopilot is not connected"),
            (lost, 0, Grade::Blocker, "the autopilot is not connected"),
            (noise, 0, Grade::Blocker, "4000 bytes came, but no message"),
            (
                unknown_peers,
                0,
                Grade::Blocker,
                "not of one autopilot that is ours",
            ),
            (
                keyless,
                150,
                Grade::Blocker,
                "messages are refused: 0 signed with another key, 9 not signed",
            ),
            (flying(), 12, Grade::Blocker, "state is known 4 times a second"),
            (unsynchronised, 150, Grade::Warning, "time is not synchronised"),
            (standby, 150, Grade::Warning, "component 196 says standby"),
        ] {
            let found = found(&after, states, &[]);
            assert!(
                found.iter().any(|(how, is)| *how == grade && is.contains(words)),
                "{words:?} is not in {found:?}"
            );
        }
    }

    #[test]
    fn a_gateway_that_is_silent_is_a_blocker() {
        let findings = judge(&Seen {
            figures: None,
            seconds: 3.0,
            states: 0,
            events: &[],
        });
        assert_eq!(
            (findings[0].grade, findings[0].about.as_str()),
            (Grade::Blocker, "gateway")
        );
    }

    #[test]
    fn what_the_pilot_has_read_of_the_link_is_reported_again_with_what_to_do() {
        let event = EventSample::new(&MODE_REFUSED, "", [4.0, 0.0]);
        let found = found(&flying(), 150, &[event]);
        assert!(found.contains(&(Grade::Warning, "jink: autopilot refused the mode, 4".to_owned())));
    }
}
