//! The parameter protocol of component 196: the table of [`jink_shared_types::params`], and what the configuration declares
//! behind it, as every ground station knows it.
//!
//! | asked | answered |
//! |---|---|
//! | PARAM_REQUEST_LIST, also to all components | every PARAM_VALUE, [`PACE_HZ`] of them a second; another request starts again |
//! | PARAM_REQUEST_READ by name or number, also to all components | PARAM_VALUE at once |
//! | PARAM_SET, to us only | PARAM_VALUE with the value in force, to everybody |
//! | the same, refused | PARAM_ERROR with the reason to whoever asked, and PARAM_VALUE with the value that stays |
//! | a change from this board ([`ParameterChange`]) | the same PARAM_VALUE, so that ground stations follow |
//!
//! A refusal is said twice because ground stations that do not know PARAM_ERROR (it is from 2025) only compare the value
//! that comes back with the one they have sent. What all components are asked about and we do not know is for others to
//! answer.

use jink_mavlink_link::encoding::{Encoding, TooWide, wire_type};
use jink_mavlink_link::ticker::Ticker;
use jink_shared_types::Timestamp;
use jink_shared_types::params::{Param, ParamError, ParamSet, ParamType};
use jink_shared_types::tuning::{PARAMETERS_MAX, ParameterChange, ParameterValues};
use mavlink::dialects::ardupilotmega::{
    MavParamError, MavParamType, PARAM_ERROR_DATA, PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, PARAM_VALUE_DATA,
};
use mavlink::types::CharArray;

/// Values per second that nobody waits for one by one (Hz). A frame has 37 bytes: 6 % of a line of 57,600 baud, which has
/// setpoints to carry, and the whole table within two seconds.
pub const PACE_HZ: f64 = 10.0;
/// How often all values are published on the board (Hz), as the topic table says.
const PUBLISH_RATE_HZ: u32 = 1;

/// What is to be sent in answer to one message.
#[derive(Clone, Debug, Default)]
pub struct Reply {
    /// Why not, to whoever asked.
    pub error: Option<PARAM_ERROR_DATA>,
    /// The value in force, to everybody.
    pub value: Option<PARAM_VALUE_DATA>,
}

/// The parameters, and what has to be told about them.
#[derive(Clone, Debug)]
pub struct Parameters {
    set: ParamSet,
    encoding: Encoding,
    /// One bit per row that somebody is to be told without having asked for it alone.
    untold: u64,
    pace: Ticker,
    changes: u32,
    answered: u64,
    /// Somebody on the board has to know at once.
    is_news: bool,
    publish_due: Timestamp,
}

const _: () = assert!(PARAMETERS_MAX <= u64::BITS as usize);

impl Parameters {
    /// With these values in force.
    pub fn new(set: &ParamSet) -> Self {
        Self {
            set: set.clone(),
            encoding: Encoding::default(),
            untold: 0,
            pace: Ticker::new(PACE_HZ),
            changes: 0,
            answered: 0,
            is_news: false,
            publish_due: Timestamp::NEVER,
        }
    }

    /// The values.
    pub fn set(&self) -> &ParamSet {
        &self.set
    }

    /// How integers travel at present.
    pub fn encoding(&self) -> Encoding {
        self.encoding
    }

    /// Speaks as the ground stations of this system expect.
    pub fn speak(&mut self, encoding: Encoding) {
        self.encoding = encoding;
    }

    /// Takes the values that another gateway has in force.
    pub fn follow(&mut self, set: &ParamSet) {
        self.set.clone_from(set);
    }

    /// Somebody wants all of them.
    pub fn request_list(&mut self) {
        self.untold = u64::MAX >> (u64::BITS as usize).saturating_sub(self.set.len());
    }

    /// Somebody wants one, from us or (`from_all`) from whoever has it.
    pub fn request_read(&self, from: (u8, u8), request: &PARAM_REQUEST_READ_DATA, from_all: bool) -> Reply {
        let row = match usize::try_from(request.param_index) {
            Ok(index) => self.set.row(index).map(|row| (index, row)),
            Err(_) => self.find(&request.param_id),
        };
        match row {
            Some((index, row)) => Reply {
                error: None,
                value: Some(self.value(index, row)),
            },
            None if from_all => Reply::default(),
            None => {
                let reason = MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST;
                Reply {
                    error: Some(error(from, &request.param_id, request.param_index, reason)),
                    value: None,
                }
            }
        }
    }

    /// Somebody wants one changed.
    pub fn request_set(&mut self, from: (u8, u8), request: &PARAM_SET_DATA) -> Reply {
        let refused = |reason| Some(error(from, &request.param_id, -1, reason));
        let Some((index, row)) = self.find(&request.param_id) else {
            return Reply {
                error: refused(MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST),
                value: None,
            };
        };
        let reason = self.change(row, request).err();
        Reply {
            error: reason.and_then(refused),
            value: Some(self.value(index, row)),
        }
    }

    fn change(&mut self, row: &Param, request: &PARAM_SET_DATA) -> Result<(), MavParamError> {
        let kind = request.param_type;
        let value = match self.encoding.take(kind, request.param_value) {
            Err(TooWide) => return Err(MavParamError::MAV_PARAM_ERROR_TYPE_UNSUPPORTED),
            // Whole numbers sent as floats are understood: scripts often know no other type. The reverse would be taken
            // for what nobody meant.
            Ok(_) if row.kind == ParamType::Float && kind != MavParamType::MAV_PARAM_TYPE_REAL32 => {
                return Err(MavParamError::MAV_PARAM_ERROR_TYPE_MISMATCH);
            }
            Ok(value) => value,
        };
        self.assign(row, value)
            .map_err(|_| MavParamError::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE)
    }

    fn assign(&mut self, row: &Param, value: f64) -> Result<(), ParamError> {
        let before = self.set.get(row);
        self.set.set(row.name, value)?;
        if self.set.get(row) != before {
            self.changes = self.changes.wrapping_add(1);
            self.is_news = true;
        }
        Ok(())
    }

    /// Somebody on this board wants one changed. What is refused is answered with the value that stays.
    pub fn take_change(&mut self, change: &ParameterChange) {
        self.answered = change.id;
        self.is_news = true;
        let index = change.row as usize;
        if let Some(row) = change.row(&self.set)
            && self.assign(row, change.value).is_ok()
        {
            self.untold |= 1 << index;
        }
    }

    /// The next value that is due to be told without having been asked for alone.
    pub fn next(&mut self, now: Timestamp) -> Option<PARAM_VALUE_DATA> {
        if self.untold == 0 || now < self.pace.due() {
            return None;
        }
        self.pace.restart(now);
        let index = self.untold.trailing_zeros() as usize;
        self.untold &= self.untold - 1;
        self.set.row(index).map(|row| self.value(index, row))
    }

    /// All values for the board, if they are due, and whether they have changed by a request.
    pub fn publish(&mut self, now: Timestamp) -> Option<(ParameterValues, bool)> {
        let is_news = std::mem::take(&mut self.is_news);
        if !is_news && now < self.publish_due {
            return None;
        }
        self.publish_due = now.next_beat(PUBLISH_RATE_HZ);
        let values = ParameterValues {
            changes: self.changes,
            answered: self.answered,
            ..ParameterValues::of(&self.set)
        };
        Some((values, is_news))
    }

    /// When something is due next.
    pub fn next_wake(&self) -> Timestamp {
        if self.untold == 0 {
            self.publish_due
        } else {
            self.publish_due.min(self.pace.due())
        }
    }

    /// The row with this name, and its number.
    fn find(&self, id: &CharArray<16>) -> Option<(usize, &'static Param)> {
        let index = self.set.number_of(id.to_str().ok()?)?;
        Some((index, self.set.row(index)?))
    }

    fn value(&self, index: usize, row: &Param) -> PARAM_VALUE_DATA {
        PARAM_VALUE_DATA {
            param_value: self.encoding.put(row.kind, self.set.get(row)),
            param_count: self.set.len() as u16,
            param_index: index as u16,
            param_id: name(row.name),
            param_type: wire_type(row.kind),
        }
    }
}

/// A name of at most 16 bytes, filled up with zeros.
fn name(name: &str) -> CharArray<16> {
    let mut bytes = [0; 16];
    for (slot, byte) in bytes.iter_mut().zip(name.bytes()) {
        *slot = byte;
    }
    CharArray::new(bytes)
}

fn error(
    (system, component): (u8, u8),
    id: &CharArray<16>,
    index: i16,
    reason: MavParamError,
) -> PARAM_ERROR_DATA {
    PARAM_ERROR_DATA {
        param_index: index,
        target_system: system,
        target_component: component,
        param_id: *id,
        error: reason,
    }
}

#[cfg(test)]
mod tests {
    use super::{Parameters, name};
    use jink_shared_types::Timestamp;
    use jink_shared_types::params::{OA_SPD_MAX, OA_YAW_MODE, ParamSet, TABLE};
    use jink_shared_types::tuning::{ParameterChange, TABLE_HASH};
    use mavlink::dialects::ardupilotmega::{
        MavParamError, MavParamType, PARAM_REQUEST_READ_DATA, PARAM_SET_DATA,
    };
    use mavlink::types::CharArray;
    use proptest::prelude::*;

    const STATION: (u8, u8) = (255, 190);

    fn at(s: f64) -> Timestamp {
        Timestamp::from_seconds(100.0 + s)
    }

    fn parameters() -> Parameters {
        Parameters::new(&ParamSet::default())
    }

    fn set(id: &str, param_value: f32, param_type: MavParamType) -> PARAM_SET_DATA {
        PARAM_SET_DATA {
            param_value,
            target_system: 1,
            target_component: 196,
            param_id: name(id),
            param_type,
        }
    }

    #[test]
    fn a_change_is_answered_with_the_new_value_and_published_once() {
        let mut parameters = parameters();
        assert!(matches!(parameters.publish(at(0.0)), Some((_, false))));
        let reply = parameters.request_set(
            STATION,
            &set("OA_SPD_MAX", 4.5, MavParamType::MAV_PARAM_TYPE_REAL32),
        );
        assert!(reply.error.is_none());
        assert_eq!(reply.value.unwrap().param_value, 4.5);
        let (values, is_news) = parameters.publish(at(0.1)).unwrap();
        assert!(is_news && values.changes == 1);
        assert!(
            values
                .rows(parameters.set())
                .any(|(row, value)| row.name == "OA_SPD_MAX" && value == 4.5)
        );
        assert!(parameters.publish(at(0.2)).is_none());
        let (_, is_news) = parameters.publish(at(1.3)).unwrap();
        assert!(!is_news, "a repetition is no news");
    }

    #[test]
    fn a_parameter_that_the_configuration_declares_is_listed_and_set_behind_the_table() {
        use jink_shared_types::params::Param;
        static OWN: [Param; 1] = [Param {
            name: "USR_SONAR_MAX",
            ..OA_SPD_MAX
        }];
        let mut parameters = Parameters::new(&ParamSet::declaring(&OWN));
        parameters.request_list();
        let told: Vec<_> = (0..).map_while(|n| parameters.next(at(f64::from(n)))).collect();
        let last = told.last().unwrap();
        assert_eq!(
            (told.len(), usize::from(last.param_count)),
            (TABLE.len() + 1, TABLE.len() + 1)
        );
        assert_eq!(last.param_id.to_str().unwrap(), "USR_SONAR_MAX");
        let real = MavParamType::MAV_PARAM_TYPE_REAL32;
        assert!(
            parameters
                .request_set(STATION, &set("USR_SONAR_MAX", 4.5, real))
                .error
                .is_none()
        );
        assert_eq!(parameters.set().named("USR_SONAR_MAX"), Some(4.5));
        let outside = parameters.request_set(STATION, &set("USR_SONAR_MAX", 99.0, real));
        assert!(outside.error.is_some());
    }

    #[test]
    fn every_refusal_names_its_reason_and_the_value_that_stays() {
        let mut parameters = parameters();
        let real = MavParamType::MAV_PARAM_TYPE_REAL32;
        for (request, reason, is_known) in [
            (
                set("OA_SPD_MAX", 99.0, real),
                MavParamError::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE,
                true,
            ),
            (
                set("OA_SPD_MAX", f32::NAN, real),
                MavParamError::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE,
                true,
            ),
            (
                set("OA_YAW_MODE", 0.5, real),
                MavParamError::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE,
                true,
            ),
            (
                set("OA_SPD_MAX", 4.0, MavParamType::MAV_PARAM_TYPE_INT32),
                MavParamError::MAV_PARAM_ERROR_TYPE_MISMATCH,
                true,
            ),
            (
                set("OA_SPD_MAX", 4.0, MavParamType::MAV_PARAM_TYPE_REAL64),
                MavParamError::MAV_PARAM_ERROR_TYPE_UNSUPPORTED,
                true,
            ),
            (
                set("MPC_XY_VEL_MAX", 4.0, real),
                MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST,
                false,
            ),
        ] {
            let reply = parameters.request_set(STATION, &request);
            let error = reply.error.unwrap();
            assert_eq!(error.error, reason);
            assert_eq!((error.target_system, error.target_component), STATION);
            assert_eq!((error.param_id, error.param_index), (request.param_id, -1));
            assert_eq!(reply.value.is_some(), is_known);
        }
        assert_eq!(parameters.set(), &ParamSet::default());
    }

    #[test]
    fn an_integer_is_taken_with_its_own_type_and_as_a_whole_float() {
        let mut parameters = parameters();
        for (raw, kind) in [
            (f32::from_bits(0), MavParamType::MAV_PARAM_TYPE_INT32),
            (1.0, MavParamType::MAV_PARAM_TYPE_REAL32),
            (f32::from_bits(0), MavParamType::MAV_PARAM_TYPE_UINT8),
        ] {
            let reply = parameters.request_set(STATION, &set("OA_YAW_MODE", raw, kind));
            assert!(reply.error.is_none());
            let bits = reply.value.unwrap().param_value.to_bits();
            assert_eq!(f64::from(bits), parameters.set().get(&OA_YAW_MODE));
        }
    }

    #[test]
    fn a_list_comes_whole_in_order_and_at_its_pace_and_a_new_request_starts_again() {
        let mut parameters = parameters();
        let mut told = Vec::new();
        parameters.request_list();
        let mut now = at(0.0);
        for tick in 0..4000u32 {
            now = at(f64::from(tick) / 1e3);
            if tick == 500 {
                parameters.request_list();
            }
            if let Some(value) = parameters.next(now) {
                assert_eq!(usize::from(value.param_count), TABLE.len());
                told.push((now, usize::from(value.param_index)));
            }
        }
        let indices: Vec<usize> = told.iter().map(|(_, index)| *index).collect();
        let expected: Vec<usize> = (0..5).chain(0..TABLE.len()).collect();
        assert_eq!(indices, expected);
        assert!(
            told.windows(2)
                .all(|pair| pair[1].0.seconds_since(pair[0].0) > 0.0999)
        );
        assert!(parameters.next(now.plus_seconds(1.0)).is_none());
    }

    #[test]
    fn one_is_read_by_name_and_by_number_and_strangers_are_left_to_others() {
        let parameters = parameters();
        let read = |param_index, id: &str, from_all| {
            let request = PARAM_REQUEST_READ_DATA {
                param_index,
                param_id: name(id),
                ..PARAM_REQUEST_READ_DATA::default()
            };
            parameters.request_read(STATION, &request, from_all)
        };
        let by_name = read(-1, "OA_SPD_MAX", true).value.unwrap();
        let by_number = read(by_name.param_index as i16, "ignored", false).value.unwrap();
        assert_eq!(by_name, by_number);
        assert_eq!(f64::from(by_name.param_value), OA_SPD_MAX.default);
        for (index, id) in [(-1, "SYS_AUTOSTART"), (999, "")] {
            assert!(read(index, id, false).error.is_some());
            let reply = read(index, id, true);
            assert!(reply.error.is_none() && reply.value.is_none());
        }
    }

    #[test]
    fn a_change_from_the_board_is_told_to_ground_stations_and_answered() {
        let mut parameters = parameters();
        let change = |id, row: usize, value| ParameterChange {
            table: TABLE_HASH,
            id,
            value,
            row: row as u32,
            reserved: jink_shared_types::Reserved::ZERO,
        };
        let row = TABLE.iter().position(|row| row.name == "OA_SPD_MAX").unwrap();
        parameters.take_change(&change(7, row, 5.0));
        assert_eq!(parameters.next(at(0.0)).unwrap().param_value, 5.0);
        assert_eq!(parameters.publish(at(0.0)).unwrap().0.answered, 7);
        for (id, row, value) in [(8, row, 99.0), (9, 99, 1.0), (10, usize::MAX, 1.0)] {
            parameters.take_change(&change(id, row, value));
            assert_eq!(parameters.publish(at(0.0)).unwrap().0.answered, id);
        }
        parameters.take_change(&ParameterChange {
            table: 1,
            ..change(11, row, 2.0)
        });
        assert_eq!(parameters.set().get(&OA_SPD_MAX), 5.0);
    }

    proptest! {
        #[test]
        fn whatever_is_sent_no_value_leaves_its_range_and_no_name_is_invented(
            requests in proptest::collection::vec((any::<[u8; 16]>(), 0..20usize, any::<u32>(), 1..11u8, any::<i16>()), 1..60),
        ) {
            let mut parameters = parameters();
            for (garbage, row, bits, kind, index) in requests {
                let param_id = TABLE.get(row).map_or(CharArray::new(garbage), |row| name(row.name));
                let kinds = [
                    MavParamType::MAV_PARAM_TYPE_UINT8, MavParamType::MAV_PARAM_TYPE_INT8,
                    MavParamType::MAV_PARAM_TYPE_UINT16, MavParamType::MAV_PARAM_TYPE_INT16,
                    MavParamType::MAV_PARAM_TYPE_UINT32, MavParamType::MAV_PARAM_TYPE_INT32,
                    MavParamType::MAV_PARAM_TYPE_UINT64, MavParamType::MAV_PARAM_TYPE_INT64,
                    MavParamType::MAV_PARAM_TYPE_REAL32, MavParamType::MAV_PARAM_TYPE_REAL64,
                ];
                let request = PARAM_SET_DATA {
                    param_id,
                    param_value: f32::from_bits(bits),
                    param_type: kinds[usize::from(kind) - 1],
                    ..PARAM_SET_DATA::default()
                };
                let reply = parameters.request_set(STATION, &request);
                prop_assert!(reply.error.is_some() || reply.value.is_some());
                let read = PARAM_REQUEST_READ_DATA { param_index: index, param_id, ..PARAM_REQUEST_READ_DATA::default() };
                let reply = parameters.request_read(STATION, &read, false);
                prop_assert!(reply.error.is_some() != reply.value.is_some());
            }
            for (row, value) in parameters.set().rows() {
                prop_assert!((row.min..=row.max).contains(&value));
            }
        }
    }
}
