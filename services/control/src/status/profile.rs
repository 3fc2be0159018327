//! Why a profile does not fit the autopilot, and what to do, in a person's words.

use jink_shared_types::link::{LinkStatus, ProfileFit};

/// What is wrong, and the remedy; `None` if the profile fits, or nothing is known yet.
pub fn unfit(status: &LinkStatus) -> Option<[String; 2]> {
    if !status.autopilot_alive.is_set() {
        return None;
    }
    let (profile, suited) = (status.profile.as_str(), status.matching_profile.as_str());
    let choose = || match suited {
        "" => "set link.profile to auto, and start jink again".to_owned(),
        suited => format!("set link.profile to auto or {suited}, and start jink again"),
    };
    let switch = match profile {
        "px4_deviation" => "EAV_EN",
        _ => "COM_OBS_AVOID",
    };
    let (is, remedy) = match status.profile_fit.get() {
        ProfileFit::Fits => return None,
        ProfileFit::Unknown if profile.is_empty() => (
            "the autopilot has not reported yet which profile is for it".to_owned(),
            "wait; if it stays so, check the wire to the autopilot, and signing".to_owned(),
        ),
        ProfileFit::Unknown => (
            format!("the autopilot has not reported yet whether \"{profile}\" is for it"),
            "wait; if it stays so, check the wire to the autopilot, and signing".to_owned(),
        ),
        ProfileFit::OtherAutopilot => (
            format!("profile \"{profile}\" is for another autopilot"),
            choose(),
        ),
        ProfileFit::OtherInterface => (
            format!("profile \"{profile}\" is for a PX4 with COM_OBS_AVOID = 0"),
            "set link.profile to auto, and start jink again; or set COM_OBS_AVOID to 0".to_owned(),
        ),
        ProfileFit::NoInterface => (
            format!("this firmware lacks the interface of profile \"{profile}\" ({switch})"),
            choose(),
        ),
        ProfileFit::SwitchedOff => (
            format!("{switch} = 0: the autopilot flies its missions without asking jink"),
            format!("set {switch} to 1"),
        ),
        ProfileFit::TooOld => (
            "no profile is for this version of the autopilot's firmware".to_owned(),
            "update the firmware".to_owned(),
        ),
    };
    Some([is, remedy])
}

#[cfg(test)]
mod tests {
    use super::unfit;
    use jink_shared_types::health::Name;
    use jink_shared_types::link::{LinkStatus, ProfileFit};
    use jink_shared_types::{Coded, Flag};

    #[test]
    fn every_misfit_has_a_sentence_and_a_remedy() {
        let reported = |profile: &str, suited: &str, fit| {
            unfit(&LinkStatus {
                profile: Name::new(profile),
                matching_profile: Name::new(suited),
                profile_fit: Coded::new(fit),
                autopilot_alive: Flag::from(true),
                ..LinkStatus::default()
            })
            .map(|parts| parts.join(" -> "))
        };
        assert_eq!(reported("px4_offboard", "px4_offboard", ProfileFit::Fits), None);
        assert_eq!(
            reported("px4_trajectory", "px4_offboard", ProfileFit::NoInterface).unwrap(),
            "this firmware lacks the interface of profile \"px4_trajectory\" (COM_OBS_AVOID) -> set link.profile to auto or \
             px4_offboard, and start jink again"
        );
        assert_eq!(
            reported("px4_deviation", "px4_offboard", ProfileFit::SwitchedOff).unwrap(),
            "EAV_EN = 0: the autopilot flies its missions without asking jink -> set EAV_EN to 1"
        );
        for fit in [
            ProfileFit::Unknown,
            ProfileFit::OtherAutopilot,
            ProfileFit::OtherInterface,
            ProfileFit::TooOld,
        ] {
            assert!(reported("px4_offboard", "", fit).is_some(), "{fit}");
        }
    }
}
