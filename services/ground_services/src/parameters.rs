//! The parameter protocol of component 196: the table of [`jink_shared_types::params`], and what the configuration declares
//! behind it, as every ground station knows it.
//!
//! | asked | answered |
//! |---|---|
//! | PARAM_REQUEST_LIST, also to all components | every PARAM_VALUE, [`PACE_HZ`] of them a second; another request starts again |
//! | PARAM_REQUEST_READ by name or number, also to all components | PARAM_VALUE at once |
//! | PARAM_SET, to us only | the parameter server is asked ([`ParameterChange`]); with its answer PARAM_VALUE with the value in force, to everybody |
//! | the same, and the server does not answer | after [`PATIENCE_S`] PARAM_VALUE with the value that stays |
//! | the same, of a value that leaves less safety than the one in force, unless the vehicle is disarmed | PARAM_ERROR, PERMISSION_DENIED |
//! | the same, refused: outside its range, or beyond the other end of its span | PARAM_ERROR with the reason to whoever asked, and PARAM_VALUE with the value that stays |
//! | a value has changed for another reason ([`ParameterValues`]) | PARAM_VALUE, so that ground stations follow |
//!
//! A refusal is said twice because ground stations that do not know PARAM_ERROR (it is from 2025) only compare the value
//! that comes back with the one they have sent. What all components are asked about and we do not know is for others to
//! answer.

use jink_mavlink_link::encoding::{Encoding, TooWide, wire_type};
use jink_mavlink_link::ticker::Ticker;
use jink_shared_types::param_messages::{PARAMETERS_MAX, ParameterChange, ParameterValues, table_of};
use jink_shared_types::params::{Param, ParamSet, ParamType};
use jink_shared_types::{Reserved, Timestamp};
use mavlink::dialect::{
    MavParamError, MavParamType, PARAM_ERROR_DATA, PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, PARAM_VALUE_DATA,
};
use mavlink::types::CharArray;

/// Values per second that nobody waits for one by one (Hz). A frame has 37 bytes: 6 % of a line of 57,600 baud, which has
/// setpoints to carry, and the whole table within two seconds.
pub const PACE_HZ: f64 = 10.0;
/// How long the parameter server is waited for (s): it answers within milliseconds, and is back within some tens after a kill.
pub const PATIENCE_S: f64 = 0.5;
/// Changes that wait for their answers: a ground station sets one after the other, scripts a few at once.
const WAITING: usize = 16;

/// What is to be sent in answer to one message.
#[derive(Clone, Debug, Default)]
pub struct Reply {
    /// Why not, to whoever asked.
    pub error: Option<PARAM_ERROR_DATA>,
    /// The value in force, to everybody.
    pub value: Option<PARAM_VALUE_DATA>,
}

/// The parameters, and what has to be reported of them.
#[derive(Clone, Debug)]
pub struct Parameters {
    set: ParamSet,
    encoding: Encoding,
    /// One bit per row that is to be sent without having been asked for alone.
    untold: u64,
    pace: Ticker,
    /// What ground stations want changed, oldest first. The first is with the parameter server, if `asked` says so.
    wanted: Vec<ParameterChange>,
    /// Until when the first is waited for.
    asked: Option<Timestamp>,
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
            wanted: Vec::with_capacity(WAITING),
            asked: None,
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

    /// Sets how integers travel from now on.
    pub fn set_encoding(&mut self, encoding: Encoding) {
        self.encoding = encoding;
    }

    /// Takes the values that the parameter server has in force; the answer to who has asked for the change that it answers.
    pub fn take_values(&mut self, values: &ParameterValues) -> Option<PARAM_VALUE_DATA> {
        for (index, (row, value)) in values.rows(&self.set).enumerate() {
            if self.set.get(row) != value && self.set.set(row.name, value).is_ok() {
                self.untold |= 1 << index;
            }
        }
        let is_answer = self.asked.is_some()
            && self
                .wanted
                .first()
                .is_some_and(|first| first.id == values.answered);
        is_answer.then(|| self.answer())?
    }

    /// The value in force of the row that was to be changed first; it is no longer waited for.
    fn answer(&mut self) -> Option<PARAM_VALUE_DATA> {
        self.asked = None;
        if self.wanted.is_empty() {
            return None;
        }
        let index = self.wanted.remove(0).row as usize;
        self.untold &= !(1 << index);
        self.set.row(index).map(|row| self.value(index, row))
    }

    /// The next change for the parameter server.
    pub fn ask(&mut self, now: Timestamp) -> Option<ParameterChange> {
        if self.asked.is_some() {
            return None;
        }
        let first = *self.wanted.first()?;
        self.asked = Some(now.plus_seconds(PATIENCE_S));
        Some(first)
    }

    /// The value that stays, if the parameter server has not answered in time.
    pub fn give_up(&mut self, now: Timestamp) -> Option<PARAM_VALUE_DATA> {
        self.asked
            .filter(|until| now >= *until)
            .and_then(|_| self.answer())
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

    /// Somebody wants one changed. If that can be, the answer comes with the parameter server's.
    pub fn request_set(
        &mut self,
        now: Timestamp,
        from: (u8, u8),
        request: &PARAM_SET_DATA,
        is_disarmed: bool,
    ) -> Reply {
        let refused = |reason| Some(error(from, &request.param_id, -1, reason));
        let Some((index, row)) = self.find(&request.param_id) else {
            return Reply {
                error: refused(MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST),
                value: None,
            };
        };
        let reason = match self.wish(row, request) {
            Ok(value) if !is_disarmed && row.is_loosened(self.set.get(row), value) => {
                Some(MavParamError::MAV_PARAM_ERROR_PERMISSION_DENIED)
            }
            Ok(value) if self.want(now, index, value) => return Reply::default(),
            // The station sees that it is not changed, and asks again.
            Ok(_) => None,
            Err(reason) => Some(reason),
        };
        Reply {
            error: reason.and_then(refused),
            value: Some(self.value(index, row)),
        }
    }

    /// Remembers what the parameter server is to be asked; `false` if too much waits already.
    fn want(&mut self, now: Timestamp, index: usize, value: f64) -> bool {
        // The first may be with the server: it stays as it was asked.
        let behind = usize::from(self.asked.is_some()).min(self.wanted.len());
        let row = index as u32;
        if let Some(waiting) = self.wanted[behind..].iter_mut().find(|one| one.row == row) {
            waiting.value = value;
            return true;
        }
        if self.wanted.len() == WAITING {
            return false;
        }
        let newest = self.wanted.last().map_or(0, |last| last.id);
        self.wanted.push(ParameterChange {
            table: table_of(&self.set),
            // Never 0, and no other request's: nobody asks at the same nanosecond of the same clock.
            id: now.ns.max(newest + 1).max(1),
            value,
            row,
            reserved: Reserved::ZERO,
        });
        true
    }

    /// The value that a request means, if the row takes it.
    fn wish(&self, row: &Param, request: &PARAM_SET_DATA) -> Result<f64, MavParamError> {
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
        // With what is on its way to the parameter server: a station that widens a span sets both ends at once.
        let mut tried = self.set.clone();
        for waiting in &self.wanted {
            if let Some(row) = tried.row(waiting.row as usize) {
                let _refused = tried.change(row.name, waiting.value);
            }
        }
        match tried.change(row.name, value) {
            Ok(()) => Ok(value),
            Err(_) => Err(MavParamError::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE),
        }
    }

    /// The next value that is due to be sent without having been asked for alone.
    pub fn next(&mut self, now: Timestamp) -> Option<PARAM_VALUE_DATA> {
        if self.untold == 0 || now < self.pace.due() {
            return None;
        }
        self.pace.restart(now);
        let index = self.untold.trailing_zeros() as usize;
        self.untold &= self.untold - 1;
        self.set.row(index).map(|row| self.value(index, row))
    }

    /// When something is due next, if it is.
    pub fn next_wake(&self) -> Option<Timestamp> {
        let pace = (self.untold != 0).then(|| self.pace.due());
        // What was answered makes room for the next, at once.
        let ask = (self.asked.is_none() && !self.wanted.is_empty()).then_some(Timestamp::NEVER);
        [pace, self.asked, ask].into_iter().flatten().min()
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
    use super::{PATIENCE_S, Parameters, WAITING, name};
    use jink_shared_types::Timestamp;
    use jink_shared_types::param_messages::{ParameterChange, ParameterValues};
    use jink_shared_types::params::{OA_SPD_MAX, OA_YAW_MODE, ParamSet, ParamType, TABLE};
    use mavlink::dialect::{MavParamError, MavParamType, PARAM_REQUEST_READ_DATA, PARAM_SET_DATA};
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

    /// What the parameter server answers to `change`.
    fn answered(parameters: &Parameters, change: &ParameterChange) -> ParameterValues {
        let mut set = parameters.set().clone();
        if let Some(row) = change.row(&set) {
            let _refused = set.set(row.name, change.value);
        }
        ParameterValues {
            answered: change.id,
            ..ParameterValues::of(&set)
        }
    }

    #[test]
    fn a_change_is_asked_for_once_and_answered_with_what_the_server_has_in_force() {
        let mut parameters = parameters();
        let request = set("OA_SPD_MAX", 4.5, MavParamType::MAV_PARAM_TYPE_REAL32);
        let reply = parameters.request_set(at(0.0), STATION, &request, true);
        assert!(reply.error.is_none() && reply.value.is_none());
        let change = parameters.ask(at(0.0)).unwrap();
        assert!(parameters.ask(at(0.1)).is_none());
        assert_eq!(parameters.set().get(&OA_SPD_MAX), OA_SPD_MAX.default);
        let reported = parameters.take_values(&answered(&parameters, &change)).unwrap();
        assert_eq!(reported.param_value, 4.5);
        assert_eq!(parameters.set().get(&OA_SPD_MAX), 4.5);
        // Reported once: the repetition of the values is no change.
        assert!(parameters.take_values(&answered(&parameters, &change)).is_none());
        assert!(parameters.next(at(1.0)).is_none() && parameters.next_wake().is_none());
    }

    #[test]
    fn a_server_that_does_not_answer_is_given_up_and_the_next_is_asked_for() {
        let mut parameters = parameters();
        let real = MavParamType::MAV_PARAM_TYPE_REAL32;
        for (name, value) in [("OA_SPD_MAX", 4.5), ("OA_ALT_MAX", 40.0), ("OA_ALT_MAX", 50.0)] {
            assert!(
                parameters
                    .request_set(at(0.0), STATION, &set(name, value, real), true)
                    .error
                    .is_none()
            );
        }
        let first = parameters.ask(at(0.0)).unwrap();
        assert!(parameters.give_up(at(0.9 * PATIENCE_S)).is_none());
        let stays = parameters.give_up(at(PATIENCE_S)).unwrap();
        assert_eq!(f64::from(stays.param_value), OA_SPD_MAX.default);
        let second = parameters.ask(at(PATIENCE_S)).unwrap();
        assert_eq!(second.value, 50.0, "the newest wish for a row counts");
        assert!(second.id > first.id);
        // An answer that comes too late is no answer to the second; its value counts all the same.
        assert!(parameters.take_values(&answered(&parameters, &first)).is_none());
        assert_eq!(parameters.set().get(&OA_SPD_MAX), 4.5);
        assert_eq!(parameters.next(at(1.0)).unwrap().param_value, 4.5);
    }

    #[test]
    fn an_end_of_a_span_is_refused_beyond_the_other_end_and_both_can_be_moved_at_once() {
        let mut parameters = parameters();
        let real = MavParamType::MAV_PARAM_TYPE_REAL32;
        let refused = parameters.request_set(at(0.0), STATION, &set("OA_DCL_HANG_LO", 5.0, real), true);
        let error = refused.error.unwrap().error;
        assert_eq!(error, MavParamError::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE);
        assert_eq!(refused.value.unwrap().param_value, 0.0);
        for (name, value) in [("OA_DCL_HANG_HI", 9.0), ("OA_DCL_HANG_LO", 5.0)] {
            let reply = parameters.request_set(at(0.1), STATION, &set(name, value, real), true);
            assert!(reply.error.is_none(), "{name}");
        }
    }

    #[test]
    fn a_flood_of_changes_waits_in_a_queue_that_has_an_end() {
        let mut parameters = parameters();
        let rows: Vec<_> = TABLE.iter().filter(|row| row.kind == ParamType::Float).collect();
        let mut waits = 0;
        for row in &rows {
            let request = set(row.name, row.max as f32, MavParamType::MAV_PARAM_TYPE_REAL32);
            let reply = parameters.request_set(at(0.0), STATION, &request, true);
            waits += usize::from(reply.value.is_none() && reply.error.is_none());
        }
        assert_eq!(waits, WAITING.min(rows.len()));
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
        let reported: Vec<_> = (0..).map_while(|n| parameters.next(at(f64::from(n)))).collect();
        let last = reported.last().unwrap();
        assert_eq!(
            (reported.len(), usize::from(last.param_count)),
            (TABLE.len() + 1, TABLE.len() + 1)
        );
        assert_eq!(last.param_id.to_str().unwrap(), "USR_SONAR_MAX");
        let real = MavParamType::MAV_PARAM_TYPE_REAL32;
        assert!(
            parameters
                .request_set(at(0.0), STATION, &set("USR_SONAR_MAX", 4.5, real), true)
                .error
                .is_none()
        );
        let change = parameters.ask(at(0.0)).unwrap();
        parameters.take_values(&answered(&parameters, &change)).unwrap();
        assert_eq!(parameters.set().named("USR_SONAR_MAX"), Some(4.5));
        let outside = parameters.request_set(at(0.0), STATION, &set("USR_SONAR_MAX", 99.0, real), true);
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
            let reply = parameters.request_set(at(0.0), STATION, &request, true);
            let error = reply.error.unwrap();
            assert_eq!(error.error, reason);
            assert_eq!((error.target_system, error.target_component), STATION);
            assert_eq!((error.param_id, error.param_index), (request.param_id, -1));
            assert_eq!(reply.value.is_some(), is_known);
        }
        assert_eq!(parameters.set(), &ParamSet::default());
    }

    #[test]
    fn what_leaves_less_safety_waits_until_the_vehicle_is_disarmed() {
        let real = MavParamType::MAV_PARAM_TYPE_REAL32;
        for row in TABLE {
            for to in [row.min, row.max] {
                if ParamSet::default().change(row.name, to).is_err() {
                    continue; // Beyond the other end of its span.
                }
                for is_disarmed in [false, true] {
                    let mut parameters = parameters();
                    let reply = parameters.request_set(
                        at(0.0),
                        STATION,
                        &set(row.name, to as f32, real),
                        is_disarmed,
                    );
                    let is_refused = !is_disarmed && row.is_loosened(row.default, to);
                    let reason = reply.error.map(|error| error.error);
                    let denied = MavParamError::MAV_PARAM_ERROR_PERMISSION_DENIED;
                    assert_eq!(reason, is_refused.then_some(denied), "{} {to}", row.name);
                    assert_eq!(
                        parameters.ask(at(0.0)).is_some(),
                        !is_refused,
                        "{} {to}",
                        row.name
                    );
                }
            }
        }
        let loosened = |name: &str, to: f64| {
            let row = TABLE.iter().find(|row| row.name == name).unwrap();
            row.is_loosened(row.default, to)
        };
        for (name, to) in [
            ("GD_MARGIN", 0.0),
            ("CP_GO_NO_DATA", 1.0),
            ("OA_UNGUARDED", 1.0),
            ("OA_SPD_MAX", 20.0),
            ("OA_VEH_RADIUS", 0.05),
            ("OA_MAP_ERR", 0.0),
            ("OA_DCL_HANG_HI", 100.0),
        ] {
            assert!(loosened(name, to), "{name}");
        }
        assert!(!loosened("OA_SPD_MAX", 1.0) && !loosened("GD_MARGIN", 0.5));
    }

    #[test]
    fn an_integer_is_taken_with_its_own_type_and_as_a_whole_float() {
        let mut parameters = parameters();
        for (raw, kind) in [
            (f32::from_bits(0), MavParamType::MAV_PARAM_TYPE_INT32),
            (1.0, MavParamType::MAV_PARAM_TYPE_REAL32),
            (f32::from_bits(0), MavParamType::MAV_PARAM_TYPE_UINT8),
        ] {
            let reply = parameters.request_set(at(0.0), STATION, &set("OA_YAW_MODE", raw, kind), true);
            assert!(reply.error.is_none());
            let change = parameters.ask(at(0.0)).unwrap();
            let reported = parameters.take_values(&answered(&parameters, &change)).unwrap();
            let bits = reported.param_value.to_bits();
            assert_eq!(f64::from(bits), parameters.set().get(&OA_YAW_MODE));
        }
    }

    #[test]
    fn a_list_comes_whole_in_order_and_at_its_pace_and_a_new_request_starts_again() {
        let mut parameters = parameters();
        let mut reported = Vec::new();
        parameters.request_list();
        let mut now = at(0.0);
        // Ten a second, and some that are sent twice.
        for tick in 0..(TABLE.len() as u32 + 10) * 100 {
            now = at(f64::from(tick) / 1e3);
            if tick == 500 {
                parameters.request_list();
            }
            if let Some(value) = parameters.next(now) {
                assert_eq!(usize::from(value.param_count), TABLE.len());
                reported.push((now, usize::from(value.param_index)));
            }
        }
        let indices: Vec<usize> = reported.iter().map(|(_, index)| *index).collect();
        let expected: Vec<usize> = (0..5).chain(0..TABLE.len()).collect();
        assert_eq!(indices, expected);
        assert!(
            reported
                .windows(2)
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
    fn a_change_from_the_board_is_reported_to_ground_stations() {
        let mut parameters = parameters();
        let mut values = ParameterValues::of(parameters.set());
        let row = TABLE.iter().position(|row| row.name == "OA_SPD_MAX").unwrap();
        values.values[row] = 5.0;
        assert!(parameters.take_values(&values).is_none());
        assert_eq!(parameters.next(at(0.0)).unwrap().param_value, 5.0);
        // What this table would not take, and what another table says, stays outside.
        for (table, value) in [(values.table, 99.0), (values.table, f64::NAN), (1, 2.0)] {
            values.table = table;
            values.values[row] = value;
            assert!(parameters.take_values(&values).is_none());
            assert_eq!(parameters.set().get(&OA_SPD_MAX), 5.0);
        }
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
                let reply = parameters.request_set(at(0.0), STATION, &request, true);
                if reply.error.is_none() && reply.value.is_none() {
                    let change = parameters.ask(at(0.0)).unwrap();
                    let row = change.row(parameters.set()).unwrap();
                    prop_assert!((row.min..=row.max).contains(&change.value));
                    prop_assert!(parameters.take_values(&answered(&parameters, &change)).is_some());
                }
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
