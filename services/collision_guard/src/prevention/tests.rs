use super::sector_states::SectorStates;
use super::{HorizontalSetpoint, Prevention, PreventionConfig, PreventionOutput};
use jink_shared_types::Timestamp;
use jink_shared_types::frames::wrap_pi;
use jink_shared_types::prevention::{PreventionCause, PreventionState};
use jink_shared_types::ring::{SECTOR_WIDTH_RAD, SECTORS, SectorRing, sector_bearing_rad, sector_of};
use nalgebra::Vector2;
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// PX4's defaults, switched on.
pub fn config() -> PreventionConfig {
    PreventionConfig {
        distance_m: 2.0,
        delay_s: 0.4,
        guide_rad: 0.0,
        goes_unseen: false,
        position_gain_per_s: 0.95,
        manual_mps: 10.0,
        jerk_mps3: 8.0,
        acceleration_mps2: 3.0,
        velocity_gain_per_s: 1.8,
    }
}

const NOW_S: f64 = 100.0;

fn now() -> Timestamp {
    Timestamp::from_seconds(NOW_S)
}

/// A ring that was measured now: a number is an obstacle, infinity nothing within 30 m, NaN unknown.
fn ring(distances_m: [f64; SECTORS]) -> SectorRing {
    SectorRing {
        distance_m: distances_m.map(|m| m as f32),
        range_max_m: distances_m.map(|m| if m.is_nan() { 0.0 } else { 30.0 }),
        seen: distances_m.map(|m| if m.is_nan() { Timestamp::NEVER } else { now() }),
        range_min_m: 0.2,
        ..SectorRing::default()
    }
}

/// Distances to straight walls, each given by the bearing of its nearest point (rad) and its distance there (m).
fn walls(walls: &[(f64, f64)]) -> [f64; SECTORS] {
    std::array::from_fn(|sector| {
        walls
            .iter()
            .map(|(bearing_rad, distance_m)| {
                let cosine = (sector_bearing_rad(sector) - bearing_rad).cos();
                let along_m = distance_m / cosine;
                if cosine > 0.0 && along_m < 30.0 {
                    along_m
                } else {
                    f64::INFINITY
                }
            })
            .fold(f64::INFINITY, f64::min)
    })
}

/// Straight walls as a ring has them: a sector reports the nearest of what it holds.
fn seen_walls(walls: &[(f64, f64)]) -> [f64; SECTORS] {
    std::array::from_fn(|sector| {
        walls
            .iter()
            .map(|(bearing_rad, distance_m)| {
                let aside_rad = wrap_pi(sector_bearing_rad(sector) - bearing_rad).abs();
                let cosine = (aside_rad - 0.5 * SECTOR_WIDTH_RAD).max(0.0).cos();
                let nearest_m = distance_m / cosine;
                if cosine > 0.0 && nearest_m < 30.0 {
                    nearest_m
                } else {
                    f64::INFINITY
                }
            })
            .fold(f64::INFINITY, f64::min)
    })
}

/// The ring of a vehicle at `place` among thin posts.
fn around_posts(posts: &[Vector2<f64>], place: &Vector2<f64>) -> SectorRing {
    let mut distances = [f64::INFINITY; SECTORS];
    for post in posts {
        let way = post - place;
        let sector = sector_of(way.y.atan2(way.x));
        distances[sector] = distances[sector].min(way.norm());
    }
    ring(distances)
}

fn polar(size: f64, bearing_rad: f64) -> Vector2<f64> {
    Vector2::new(size * bearing_rad.cos(), size * bearing_rad.sin())
}

fn step(
    config: PreventionConfig,
    ring: &SectorRing,
    demand: HorizontalSetpoint,
    velocity: Vector2<f64>,
) -> PreventionOutput {
    Prevention::new(config).step(now(), ring, demand, velocity)
}

fn pushed(
    config: PreventionConfig,
    ring: &SectorRing,
    stick: Vector2<f64>,
    velocity: Vector2<f64>,
) -> Vector2<f64> {
    step(config, ring, HorizontalSetpoint::Acceleration(stick), velocity).setpoint
}

fn distances() -> impl Strategy<Value = [f64; SECTORS]> {
    let one = prop_oneof![
        3 => 0.0..30.0f64,
        2 => Just(f64::INFINITY),
        1 => Just(f64::NAN),
    ];
    proptest::collection::vec(one, SECTORS).prop_map(|v| v.try_into().unwrap())
}

/// Rooms of one to four walls: rings as they are, and no sector unknown.
fn rooms() -> impl Strategy<Value = [f64; SECTORS]> {
    proptest::collection::vec((0.0..std::f64::consts::TAU, 0.5..20.0f64), 1..5).prop_map(|list| walls(&list))
}

fn plane(size: f64) -> impl Strategy<Value = Vector2<f64>> {
    (0.0..size, 0.0..std::f64::consts::TAU).prop_map(|(size, bearing)| polar(size, bearing))
}

fn configs() -> impl Strategy<Value = PreventionConfig> {
    (
        0.2..10.0f64,
        0.0..1.0f64,
        0.0..90.0f64,
        any::<bool>(),
        2.0..15.0f64,
        1.0..50.0f64,
    )
        .prop_map(
            |(distance_m, delay_s, guide_deg, goes_unseen, acceleration_mps2, jerk_mps3)| PreventionConfig {
                distance_m,
                delay_s,
                guide_rad: guide_deg.to_radians(),
                goes_unseen,
                acceleration_mps2,
                jerk_mps3,
                ..config()
            },
        )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    #[test]
    fn the_answer_is_finite_and_bounded_whatever_comes(
        distances in proptest::collection::vec(any::<f64>(), SECTORS), config in configs(),
        stick in any::<[f64; 2]>(), velocity in any::<[f64; 2]>(), by_velocity in any::<bool>(),
    ) {
        let ring = ring(distances.try_into().unwrap());
        let stick = Vector2::from(stick);
        let demand = if by_velocity { HorizontalSetpoint::Velocity(stick) } else { HorizontalSetpoint::Acceleration(stick) };
        let answer = step(config, &ring, demand, Vector2::from(velocity)).setpoint;
        let size = stick.norm();
        let asked = if size < 1e3 { size } else { 0.0 };
        // A velocity is approached from the vehicle's own.
        let own = if by_velocity { Vector2::from(velocity).norm() } else { 0.0 };
        let own = if own < 1e3 { own } else { 0.0 };
        prop_assert!(answer.norm() <= config.acceleration_mps2.max(asked).max(own) + 1e-6, "{answer}");
    }

    /// The closing speed toward anything known is never raised beyond the one from which the vehicle stops in time.
    #[test]
    fn nothing_is_closed_on_faster_than_one_can_stop(
        distances in rooms(), config in configs(), stick in plane(10.0), velocity in plane(12.0),
    ) {
        let config = PreventionConfig { guide_rad: 0.0, ..config };
        let answer = pushed(config, &ring(distances), stick, velocity);
        for (sector, distance_m) in distances.into_iter().enumerate() {
            let toward = polar(1.0, sector_bearing_rad(sector));
            let distance_m = distance_m.min(30.0);
            let closing = velocity.dot(&toward);
            let way = distance_m - config.distance_m - closing.max(0.0) * config.delay_s;
            let limit = super::speed_limit(way, config.acceleration_mps2, config.jerk_mps3, 0.0);
            let granted = super::scale(&config, config.distance_m, distance_m).max(0.0) * stick.dot(&toward).max(0.0);
            let may = (config.velocity_gain_per_s * (limit - closing) + granted).max(-config.acceleration_mps2);
            // A bounded result may be short of what is needed where obstacles on several sides need different things.
            if may >= 0.0 {
                prop_assert!(answer.dot(&toward) <= may + 1e-3, "sector {}: {} of {}", sector, answer.dot(&toward), may);
            }
        }
    }

    /// At rest and nearer than the distance to keep, nothing leads nearer.
    #[test]
    fn who_is_too_near_already_comes_no_nearer(distances in rooms(), config in configs(), stick in plane(10.0)) {
        let answer = pushed(config, &ring(distances), stick, Vector2::zeros());
        for (sector, distance_m) in distances.into_iter().enumerate() {
            if distance_m <= config.distance_m {
                let toward = polar(1.0, sector_bearing_rad(sector));
                prop_assert!(answer.dot(&toward) < 1e-3, "sector {sector}");
            }
        }
    }

    /// A stick turned by a thousandth of a degree turns the answer by no more than a few times that.
    #[test]
    fn the_answer_is_continuous_in_the_angle_of_the_stick(
        distances in distances(), bearing in 0.0..std::f64::consts::TAU, velocity in plane(8.0),
    ) {
        const STEP_RAD: f64 = 1e-5;
        let ring = ring(distances);
        let size = 3.0;
        let here = pushed(config(), &ring, polar(size, bearing), velocity);
        let there = pushed(config(), &ring, polar(size, bearing + STEP_RAD), velocity);
        // The share falls from one to minus one within a sector of 5 degrees, or half of one: 50 / rad.
        prop_assert!((there - here).norm() <= 60.0 * size * STEP_RAD, "{here} {there}");
    }

    /// Before a wall, whatever is asked for and however fast the vehicle is.
    #[test]
    fn a_velocity_is_one_from_which_one_can_stop(
        bearing in 0.0..std::f64::consts::TAU, distance_m in 0.3..25.0f64, config in configs(), desired in plane(15.0), velocity in plane(8.0),
    ) {
        let config = PreventionConfig { guide_rad: 0.0, ..config };
        let answer = step(config, &ring(seen_walls(&[(bearing, distance_m)])), HorizontalSetpoint::Velocity(desired), velocity).setpoint;
        let v = answer.dot(&polar(1.0, bearing));
        let way = (distance_m - config.distance_m).max(0.0);
        let delay_s = config.delay_s + 1.0 / config.velocity_gain_per_s;
        let needed = v * delay_s + v * 2.0 * config.acceleration_mps2 / config.jerk_mps3 + v * v / (2.0 * config.acceleration_mps2);
        // Where it is seen at less than 15 degrees a wall may not be known to be one: hits of its sectors are far apart (`outline.rs`).
        // Who grazes it has four times as far to go as to it, and sees it better on the way.
        let grazes = v < 15f64.to_radians().sin() * answer.norm();
        // Sectors hide where in their 5 degrees the wall is nearest, and a contact may be broken by what a centred
        // stick is.
        prop_assert!(v <= 2e-3 || grazes || needed <= way + 0.01 + 0.01 * distance_m, "{} of {}", needed, way);
        prop_assert!(answer.norm() <= desired.norm().max(velocity.norm()).max(super::RETREAT_MPS) + 1e-9);
    }

    /// Posts anywhere, a stick held anywhere, a vehicle that follows with a lag: it never comes nearer than CP_DIST,
    /// except for what a sector hides.
    #[test]
    fn who_follows_the_answers_keeps_the_distance(
        posts in proptest::collection::vec((3.2..25.0f64, 0.0..std::f64::consts::TAU), 1..8), desired in plane(8.0),
    ) {
        let posts: Vec<_> = posts.into_iter().map(|(distance, bearing)| polar(distance, bearing)).collect();
        let (config, mut prevention) = (config(), Prevention::new(config()));
        let (mut place, mut velocity, mut nearest_m) = (Vector2::zeros(), Vector2::zeros(), f64::INFINITY);
        for tick in 0..1_000 {
            let now = Timestamp::from_seconds(NOW_S + 0.02 * f64::from(tick));
            let ring = SectorRing { seen: [now; SECTORS], ..around_posts(&posts, &place) };
            let answer = prevention.step(now, &ring, HorizontalSetpoint::Velocity(desired), velocity).setpoint;
            velocity += (answer - velocity) * config.velocity_gain_per_s * 0.02;
            place += velocity * 0.02;
            nearest_m = posts.iter().map(|post| (post - place).norm()).fold(nearest_m, f64::min);
        }
        prop_assert!(nearest_m > config.distance_m - 0.12, "{}", nearest_m);
    }

    #[test]
    fn it_is_the_same_whatever_the_heading(distances in rooms(), stick in plane(10.0), velocity in plane(8.0), turn in 0..SECTORS) {
        // Of two obstacles at one distance the one nearer to the nose is split after, as in PX4.
        let mut sorted = distances;
        sorted.sort_by(f64::total_cmp);
        if sorted[1] - sorted[0] < 0.002 {
            return Ok(());
        }
        let answer = pushed(config(), &ring(distances), stick, velocity);
        let yaw_rad = sector_bearing_rad(turn);
        let mut turned = ring(std::array::from_fn(|sector| distances[(sector + turn) % SECTORS]));
        turned.attitude = jink_shared_types::frames::Attitude::from_rotation(
            nalgebra::UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad),
        );
        let same = pushed(config(), &turned, stick, velocity);
        prop_assert!((answer - same).norm() < 1e-3, "{answer} {same}");
    }
}

#[test]
fn a_ring_that_does_not_say_where_its_sectors_point_says_nothing() {
    let mut lost = ring([f64::INFINITY; SECTORS]);
    assert!(SectorStates::of(&lost, now()).has_data());
    lost.attitude.w = f64::NAN;
    assert!(!SectorStates::of(&lost, now()).has_data());
}

#[test]
fn far_from_everything_the_stick_is_what_is_flown() {
    let far = ring([f64::INFINITY; SECTORS]);
    let outcome = step(
        config(),
        &far,
        HorizontalSetpoint::Acceleration(polar(3.0, 0.7)),
        Vector2::zeros(),
    );
    assert!((outcome.setpoint - polar(3.0, 0.7)).norm() < 1e-12);
    assert_eq!(
        (outcome.state, outcome.cause),
        (PreventionState::Free, PreventionCause::None)
    );
}

#[test]
fn switched_off_it_passes_everything() {
    let off = PreventionConfig {
        distance_m: -1.0,
        ..config()
    };
    let blind = ring([f64::NAN; SECTORS]);
    let outcome = step(
        off,
        &blind,
        HorizontalSetpoint::Acceleration(polar(3.0, 0.7)),
        Vector2::zeros(),
    );
    assert_eq!(
        (outcome.setpoint, outcome.state),
        (polar(3.0, 0.7), PreventionState::Off)
    );
}

/// In PX4 the second wall does not count as soon as the stick is slightly past the perpendicular to the first.
#[test]
fn a_second_wall_counts_whichever_is_nearer() {
    let corner = ring(walls(&[(0.0, 1.5), (FRAC_PI_2, 1.7)]));
    for degrees in [80.0f64, 89.9, 90.0, 90.1, 100.0] {
        let answer = pushed(
            config(),
            &corner,
            polar(3.0, degrees.to_radians()),
            Vector2::zeros(),
        );
        assert!(answer.x < 1e-6 && answer.y < 1e-6, "{degrees} deg: {answer}");
    }
}

#[test]
fn in_a_round_room_all_directions_are_alike() {
    let room = ring([7.0; SECTORS]);
    let sizes: Vec<f64> = (0..72)
        .map(|k| {
            pushed(
                config(),
                &room,
                polar(3.0, f64::from(k) * 0.087),
                Vector2::zeros(),
            )
            .norm()
        })
        .collect();
    let (least, most) = sizes
        .iter()
        .fold((f64::INFINITY, 0.0f64), |(a, b), s| (a.min(*s), b.max(*s)));
    assert!(
        most - least < 0.01 && (0.6..0.75).contains(&least),
        "{least} to {most}"
    );
}

#[test]
fn a_centred_stick_brakes_before_a_wall() {
    let wall = ring(walls(&[(0.0, 4.0)]));
    let answer = pushed(config(), &wall, Vector2::zeros(), polar(5.0, 0.0));
    assert!(answer.x < -2.9, "{answer}");
}

#[test]
fn along_a_wall_and_away_from_it_motion_goes_on() {
    let wall = ring(walls(&[(0.0, 2.2)]));
    let along = pushed(config(), &wall, polar(3.0, FRAC_PI_2), Vector2::zeros());
    assert!(along.y > 2.0 && along.x < 1e-6, "{along}");
    let away = pushed(config(), &wall, polar(3.0, PI), Vector2::zeros());
    assert!((away - polar(3.0, PI)).norm() < 1e-6, "{away}");
}

#[test]
fn where_no_sensor_looks_nothing_moves_and_motion_there_is_braked() {
    let mut ahead_only = [f64::NAN; SECTORS];
    for sector in [69, 70, 71, 0, 1, 2, 3] {
        ahead_only[sector] = f64::INFINITY;
    }
    let ring = ring(ahead_only);
    let aside = step(
        config(),
        &ring,
        HorizontalSetpoint::Acceleration(polar(3.0, 1.5)),
        Vector2::zeros(),
    );
    assert_eq!(
        (aside.setpoint, aside.cause),
        (Vector2::zeros(), PreventionCause::Unseen)
    );
    let ahead = pushed(config(), &ring, polar(3.0, 0.0), Vector2::zeros());
    assert!(ahead.x > 2.9, "{ahead}");
    let drifting = pushed(config(), &ring, Vector2::zeros(), polar(1.0, 1.5));
    assert!(drifting.dot(&polar(1.0, 1.5)) < -1.5, "{drifting}");
    let allowed = PreventionConfig {
        goes_unseen: true,
        ..config()
    };
    assert!(pushed(allowed, &ring, polar(3.0, 1.5), Vector2::zeros()).norm() > 2.9);
    // What was seen once and is no longer is not "never seen".
    let mut prevention = Prevention::new(allowed);
    let all = super::tests::ring([f64::INFINITY; SECTORS]);
    prevention.step(
        now(),
        &all,
        HorizontalSetpoint::Acceleration(Vector2::zeros()),
        Vector2::zeros(),
    );
    let lost = prevention.step(
        now(),
        &ring,
        HorizontalSetpoint::Acceleration(polar(3.0, 1.5)),
        Vector2::zeros(),
    );
    assert_eq!(lost.setpoint, Vector2::zeros());
}

#[test]
fn guidance_takes_the_better_side_and_never_one_without_data() {
    let mut post = [f64::INFINITY; SECTORS];
    for sector in [70, 71, 0, 1] {
        post[sector] = 4.0;
    }
    let guided = PreventionConfig {
        guide_rad: 30f64.to_radians(),
        ..config()
    };
    let outcome = step(
        guided,
        &ring(post),
        HorizontalSetpoint::Acceleration(polar(3.0, 0.01)),
        Vector2::zeros(),
    );
    assert_eq!(
        (outcome.guided, outcome.cause),
        (Some(3), PreventionCause::Guided)
    );
    assert!(outcome.setpoint.y > 0.3, "{outcome:?}");
    post[2..20].fill(f64::NAN);
    let outcome = step(
        guided,
        &ring(post),
        HorizontalSetpoint::Acceleration(polar(3.0, 0.01)),
        Vector2::zeros(),
    );
    assert!(outcome.guided.is_some_and(|sector| sector > 60), "{outcome:?}");
}

#[test]
fn without_data_nothing_moves_then_the_pilot_is_notified_then_the_vehicle_holds() {
    let mut prevention = Prevention::new(config());
    let mut reported = Vec::new();
    let seen = ring([f64::INFINITY; SECTORS]);
    let blind = ring([f64::NAN; SECTORS]);
    for tenth in 0..100 {
        let at_s = NOW_S + 0.1 * f64::from(tenth);
        // The ring calls its sectors unknown half a second after they were seen.
        let sectors = if tenth <= 15 { &seen } else { &blind };
        let mut sectors = *sectors;
        if tenth <= 15 {
            sectors.seen = [Timestamp::from_seconds(NOW_S + 0.1 * f64::from(tenth.min(10))); SECTORS];
        }
        let outcome = prevention.step(
            Timestamp::from_seconds(at_s),
            &sectors,
            HorizontalSetpoint::Acceleration(polar(3.0, 0.0)),
            Vector2::zeros(),
        );
        if reported.last().map(|(_, state)| *state) != Some(outcome.state) {
            reported.push((tenth, outcome.state));
        }
        if outcome.state != PreventionState::Free {
            assert_eq!(outcome.setpoint, Vector2::zeros());
            assert!(outcome.must_warn);
        }
    }
    assert_eq!(
        reported,
        [
            (0, PreventionState::Free),
            (16, PreventionState::Blind),
            (61, PreventionState::Hold)
        ]
    );
}

/// With the demanded velocity as the vehicle's own: the setpoint begins there.
fn flown(config: PreventionConfig, ring: &SectorRing, desired: Vector2<f64>) -> Vector2<f64> {
    step(config, ring, HorizontalSetpoint::Velocity(desired), desired).setpoint
}

#[test]
fn along_a_wall_nothing_is_lost_and_toward_it_nothing_is_left() {
    for bearing in [0.0, 0.3, 1.0, 2.5, 4.0] {
        let wall = ring(seen_walls(&[(bearing, 2.05)]));
        let along = flown(config(), &wall, polar(5.0, bearing + FRAC_PI_2));
        assert!((along - polar(5.0, bearing + FRAC_PI_2)).norm() < 0.05, "{along}");
        let oblique = flown(config(), &wall, polar(5.0, bearing + FRAC_PI_4));
        let slides = oblique.dot(&polar(1.0, bearing + FRAC_PI_2));
        assert!(slides > 2.5, "of 3.5 m/s along it {slides} are left");
        assert!(flown(config(), &wall, polar(5.0, bearing)).norm() < 0.2);
    }
}

#[test]
fn between_two_walls_nothing_is_lost() {
    let corridor = ring(seen_walls(&[(FRAC_PI_2, 2.2), (-FRAC_PI_2, 2.2)]));
    let desired = polar(5.0, 0.0);
    assert!((flown(config(), &corridor, desired) - desired).norm() < 0.05);
}

#[test]
fn what_stands_alone_beside_the_way_may_step_into_it() {
    let desired = polar(5.0, 0.0);
    let beside = |aside_m: f64| {
        let ring = around_posts(&[Vector2::new(4.0, aside_m)], &Vector2::zeros());
        flown(config(), &ring, desired).norm()
    };
    assert!(beside(3.0) < 3.5, "{}", beside(3.0));
    assert!(beside(6.5) > 4.99, "{}", beside(6.5));
}

#[test]
fn into_a_corner_two_walls_count() {
    let corner = ring(seen_walls(&[(0.0, 2.02), (FRAC_PI_2, 2.02)]));
    assert!(flown(config(), &corner, polar(5.0, FRAC_PI_4)).norm() < 0.1);
}

#[test]
fn what_came_too_near_is_left_while_the_stick_is_pushed() {
    let wall = ring(seen_walls(&[(0.0, 1.5)]));
    let pushed = step(
        config(),
        &wall,
        HorizontalSetpoint::Velocity(polar(5.0, 0.0)),
        Vector2::zeros(),
    )
    .setpoint;
    assert!((pushed - polar(-0.9, 0.0)).norm() < 0.02, "{pushed}");
    let centred = step(
        config(),
        &wall,
        HorizontalSetpoint::Velocity(Vector2::zeros()),
        Vector2::zeros(),
    )
    .setpoint;
    assert_eq!(centred, Vector2::zeros());
}
