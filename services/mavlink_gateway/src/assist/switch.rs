//! A switch of the remote control: one channel of RC_CHANNELS, up is on.

/// From here on (us) a switch is up ...
const UP_US: u16 = 1700;
/// ... and down from here on. In between, as a switch of three positions has it, it is as it was.
const DOWN_US: u16 = 1300;

/// What the switch says.
#[derive(Clone, Copy, Debug, Default)]
pub struct Switch {
    is_up: Option<bool>,
}

impl Switch {
    /// Takes the channel's pulse width (us); what the pilot has just done, if he has done something. Where the switch is found at
    /// first says nothing: it must be down before up means on.
    pub fn take(&mut self, raw_us: Option<u16>) -> Option<bool> {
        let is_up = match raw_us {
            Some(UP_US..) => true,
            Some(..=DOWN_US) => false,
            _ => return None,
        };
        let before = self.is_up.replace(is_up);
        (before == Some(!is_up)).then_some(is_up)
    }
}

#[cfg(test)]
mod tests {
    use super::Switch;

    #[test]
    fn up_means_on_once_it_was_down() {
        let mut switch = Switch::default();
        let said: Vec<_> = [2000, 2000, 1500, 1000, 1500, 1900, 1900, 1500, 1100]
            .map(|raw_us| switch.take(Some(raw_us)))
            .to_vec();
        let expected = [
            None,
            None,
            None,
            Some(false),
            None,
            Some(true),
            None,
            None,
            Some(false),
        ];
        assert_eq!(said, expected);
        assert_eq!(switch.take(None), None);
    }
}
