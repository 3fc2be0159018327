//! Two guards and rings that get the same inputs answer the same, to the bit.

use crate::common::{Lidar, World, fly, guard, on, random, ring, step, straight, time};
use jink_shared_types::hash;
use jink_shared_types::ring::SectorRing;

/// FNV-1a over the bits of everything a flight answers.
fn fingerprint(seed: u64) -> u64 {
    let world = World(vec![[22.0, 0.0, 0.3], [5.0, 4.0, 0.3], [12.0, -3.0, 0.3]]);
    let first = straight(7, 10.0, 3.0, 2.0, 40.0);
    let lidar = Lidar {
        sigma_m: 0.03,
        ..Lidar::default()
    };
    let mut random = random(seed);
    let (mut guard, mut ring) = (guard(), ring());
    let mut flown = first;
    let mut hash = hash::START;
    let mut add = |bits: u64| hash = hash::number(hash, bits);
    for i in 0..100 {
        let t = 10.0 + 0.1 * f64::from(i);
        let place = |t: f64| on(&flown, t);
        fly(&mut ring, &place, t - 0.2, t);
        let (cloud, header) = lidar.sweep(&world, &place, t, &mut random);
        ring.cloud(0, &cloud, &header).unwrap();
        let (out, step_events) = step(&mut guard, t, (i == 0).then_some(&first), &ring, place(t));
        add(out.free_way_m.to_bits());
        add(out.stopping_m.to_bits());
        add(out.trajectory.id);
        add(step_events.events().len() as u64);
        for piece in out.trajectory.pieces() {
            add(piece.duration_s.to_bits());
            for point in piece.position {
                add(point.x_m.to_bits());
            }
        }
        let mut sectors = SectorRing::default();
        ring.ring(time(t), &mut sectors);
        for (distance, range) in sectors.distance_m.iter().zip(sectors.range_max_m) {
            add(u64::from(distance.to_bits()) << 32 | u64::from(range.to_bits()));
        }
        flown = out.trajectory;
    }
    hash
}

#[test]
fn to_the_bit() {
    assert_eq!(fingerprint(1), fingerprint(1));
    assert_ne!(fingerprint(1), fingerprint(2), "the fingerprint sees the noise");
}
