//! Builds of one topic over real shared memory: those that would misread each other are refused, and a field that
//! came later is read as what it is.

use jink_runtime::{Instance, OpenError, Session, now};
use jink_shared_types::layout::Layout;
use jink_shared_types::topics::{LINK_STATUS, Topic};
use jink_shared_types::{Reserved, SampleHeader};

/// The same sample as one build has it.
macro_rules! build {
    ($module:ident, $cell_m:literal, hit $hit:literal, clear $clear:literal, $($field:ident: $type:ty),*) => {
        mod $module {
            jink_shared_types::wire_enum! {
                /// What a ray met.
                pub enum Met {
                    /// Not known.
                    Unknown = 0 "unknown",
                    /// An obstacle.
                    Hit = $hit "hit",
                    /// Nothing.
                    Clear = $clear "clear",
                }
            }
            const CELL_M: f64 = $cell_m;
            jink_shared_types::sample! {
                /// The sample.
                #[derive(Clone, Copy, Debug, Default)]
                pub struct Ray: 32 { $(
                    /// A field.
                    pub $field: $type,
                )* }
                means { CELL_M: f64 }
            }
        }
    };
}
build!(old, 0.2, hit 1, clear 2,
    cells: u64, met: jink_shared_types::Coded<Met>, reserved: super::Reserved<7>, reserved_tail: super::Reserved<16>);
build!(codes_exchanged, 0.2, hit 2, clear 1,
    cells: u64, met: jink_shared_types::Coded<Met>, reserved: super::Reserved<7>, reserved_tail: super::Reserved<16>);
build!(finer_cells, 0.1, hit 1, clear 2,
    cells: u64, met: jink_shared_types::Coded<Met>, reserved: super::Reserved<7>, reserved_tail: super::Reserved<16>);
build!(new, 0.2, hit 1, clear 2,
    cells: u64, met: jink_shared_types::Coded<Met>, reserved: super::Reserved<7>,
    intensity: jink_shared_types::Added<f64>, reserved_tail: super::Reserved<8>);

/// The topic as a build has it.
fn topic<T>() -> Topic<T> {
    LINK_STATUS.with_payload()
}

/// An instance of its own that leaves nothing behind.
struct Isolated(Instance);

impl Isolated {
    fn new(test: &str) -> Self {
        let instance: Instance = format!("rt_{test}_{}", std::process::id()).parse().unwrap();
        instance.make_folder().unwrap();
        Self(instance)
    }

    fn producer(&self) -> Session {
        Session::open(&self.0, "mavlink_gateway").unwrap()
    }

    fn reader(&self) -> Session {
        Session::open(&self.0, "supervisor").unwrap()
    }
}

impl Drop for Isolated {
    fn drop(&mut self) {
        self.0.wipe().unwrap();
        std::fs::remove_dir_all(self.0.folder()).unwrap();
    }
}

fn is_refused<T: Layout>(isolated: &Isolated) -> bool {
    matches!(
        isolated.reader().input(topic::<T>(), ""),
        Err(OpenError::Layout { .. })
    )
}

#[test]
fn other_codes_and_other_constants_are_refused() {
    let isolated = Isolated::new("refused");
    let producer = isolated.producer();
    let _held = producer.output(topic::<old::Ray>(), "", 1).unwrap();
    assert!(is_refused::<codes_exchanged::Ray>(&isolated));
    assert!(is_refused::<finer_cells::Ray>(&isolated));
    assert!(!is_refused::<old::Ray>(&isolated));
}

#[test]
fn a_new_reader_finds_an_added_field_absent_in_an_old_producers_samples() {
    let isolated = Isolated::new("old_new");
    let (producer, reader) = (isolated.producer(), isolated.reader());
    let mut output = producer.output(topic::<old::Ray>(), "", 1).unwrap();
    let mut input = reader.input(topic::<new::Ray>(), "").unwrap();
    let ray = old::Ray {
        cells: 3,
        met: old::Met::Hit.into(),
        ..old::Ray::default()
    };
    assert!(output.send(SampleHeader::at(now()), &ray));
    input.latest(now());
    let read = input.newest().unwrap();
    assert_eq!((read.cells, read.met.get()), (3, new::Met::Hit));
    assert_eq!(read.intensity.get(), None);
}

#[test]
fn an_old_reader_takes_what_a_new_producer_sends_and_a_new_reader_finds_the_field() {
    let isolated = Isolated::new("new_old");
    let (producer, reader) = (isolated.producer(), isolated.reader());
    let mut output = producer.output(topic::<new::Ray>(), "", 1).unwrap();
    let mut of_old = reader.input(topic::<old::Ray>(), "").unwrap();
    let mut of_new = reader.input(topic::<new::Ray>(), "").unwrap();
    let ray = new::Ray {
        cells: 4,
        intensity: jink_shared_types::Added::new(0.5),
        ..new::Ray::default()
    };
    assert!(output.send(SampleHeader::at(now()), &ray));
    of_old.latest(now());
    of_new.latest(now());
    assert_eq!(of_old.newest().unwrap().cells, 4);
    assert_eq!(of_new.newest().unwrap().intensity.get(), Some(0.5));
}
