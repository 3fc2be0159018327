//! The hot path allocates nothing: not for frames, noise, set-up, scans, parts of sweeps.

use crate::encoder::{benewake, cm8jl65, sf45, spec, text};
use allocation_counter::measure;
use jink_rangefinder_driver::RangefinderDriver;
use jink_shared_types::Timestamp;
use jink_shared_types::ranges::RangeScan;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::SplitMix64;

#[test]
fn a_minute_of_every_device_with_noise_in_it() {
    for name in ["sf45b", "cm8jl65", "tfmini", "tf_luna", "sf11c", "lw20c"] {
        let mut random = SplitMix64::seed_from_u64(5);
        let wires: Vec<Vec<u8>> = (0..6_000i16)
            .map(|index| {
                let cm = 100 + index % 400;
                let mut wire = match name {
                    "sf45b" => sf45(cm, (index % 320 - 160) * 100),
                    "cm8jl65" => cm8jl65(cm as u16 * 10),
                    "sf11c" | "lw20c" => text(cm.into()),
                    _ => benewake(cm, 800, 20.0),
                };
                if random.random_ratio(1, 10) {
                    wire.extend((0..random.random_range(0..20)).map(|_| random.random::<u8>()));
                }
                wire
            })
            .collect();
        let mut driver = RangefinderDriver::new(spec(name, "/dev/x", ""));
        let mut scan = RangeScan::default();
        let mut scans = 0;
        let allocations = measure(|| {
            for (index, wire) in wires.iter().enumerate() {
                let now = Timestamp::from_ns(1_000_000_000 + index as u64 * 10_000_000);
                if index == 3_000 {
                    driver.connected(now);
                }
                let mut publish = |view: &jink_rangefinder_driver::ScanView<'_>| {
                    view.write(&mut scan);
                    scans += 1;
                };
                driver.bytes(now, wire, &mut publish);
                driver.tick(now, &mut publish);
                while driver.next_write(now).is_some() {}
                driver.take_change(now);
                driver.counters(now);
            }
        });
        assert!(scans > 500, "{name}: {scans}");
        assert_eq!(allocations.count_total, 0, "{name}");
    }
}
