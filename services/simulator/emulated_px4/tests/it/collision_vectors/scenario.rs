//! Steps of a whole instance: publish the inputs, tick, compare everything that is not fragile.

use super::report::Report;
use super::{single, vector};
use jink_emulated_px4::collision_prevention::{
    CollisionPrevention, DistanceSensor, ObstacleDistance, Outcome, Settings, project,
};
use jink_testkit::vectors::{
    distances_cm, flag, indices, list, list_if_any, number, numbers, unrolled, whole,
};
use nalgebra::Vector2;
use serde_json::Value;

pub fn replay(scenario: &Value, report: &mut Report) {
    let mut settings = Settings::default();
    change(&mut settings, &scenario["params"]);
    let mut prevention = CollisionPrevention::new(settings);
    let mut attitude = [1.0, 0.0, 0.0, 0.0];
    for step in list(&scenario["steps"]) {
        report.step();
        change(&mut settings, &step["params"]);
        prevention.set(settings);
        if let Some(published) = step.get("attitude") {
            attitude = numbers(&published["q"]).map(|x| x as f32);
            prevention.attitude(attitude);
        }
        for reading in list_if_any(step, "distance_sensors") {
            prevention.distance_sensor(whole(&reading["instance"]) as usize, distance_sensor(reading));
        }
        if let Some(message) = step.get("obstacle_distance") {
            prevention.obstacle_distance(obstacle_distance(message));
        }
        let now_us = whole(&step["t_us"]) as u64;
        let outcome = prevention.tick(now_us, vector(&step["setpoint_accel"]), vector(&step["velocity"]));
        compare_map(&prevention, &outcome, step, report);
        compare_outcome(&outcome, step, report);
        if let Some(expected) = step["expect"].get("projection") {
            let reading = distance_sensor(&step["distance_sensors"][0]);
            compare_projection(&reading, attitude, expected, report);
        }
    }
}

/// Names as in PX4.
fn change(settings: &mut Settings, parameters: &Value) {
    let set = |name: &str, to: &mut f32| {
        if let Some(value) = parameters.get(name) {
            *to = single(value);
        }
    };
    set("CP_DIST", &mut settings.distance_m);
    set("CP_DELAY", &mut settings.delay_s);
    set("CP_GUIDE_ANG", &mut settings.guide_deg);
    set("MPC_XY_P", &mut settings.position_gain_per_s);
    set("MPC_VEL_MANUAL", &mut settings.manual_speed_mps);
    set("MPC_JERK_MAX", &mut settings.jerk_mps3);
    set("MPC_ACC_HOR", &mut settings.acceleration_mps2);
    set("MPC_XY_VEL_P_ACC", &mut settings.velocity_gain_per_s);
    if let Some(value) = parameters.get("CP_GO_NO_DATA") {
        settings.go_without_data = number(value) != 0.0;
    }
}

fn distance_sensor(reading: &Value) -> DistanceSensor {
    DistanceSensor {
        time_us: whole(&reading["t_us"]) as u64,
        min_m: single(&reading["min_m"]),
        max_m: single(&reading["max_m"]),
        distance_m: single(&reading["current_m"]),
        quality: whole(&reading["quality"]) as i8,
        orientation: whole(&reading["orientation"]) as u8,
        field_of_view_rad: single(&reading["h_fov_rad"]),
        body_q_sensor: numbers(&reading["q"]).map(|x| x as f32),
    }
}

fn obstacle_distance(message: &Value) -> ObstacleDistance {
    ObstacleDistance {
        time_us: whole(&message["t_us"]) as u64,
        frame: whole(&message["frame"]) as u8,
        increment_deg: single(&message["increment_deg"]),
        offset_deg: single(&message["angle_offset_deg"]),
        min_cm: whole(&message["min_cm"]) as u16,
        max_cm: whole(&message["max_cm"]) as u16,
        distances_cm: distances_cm(&message["distances_cm"]),
    }
}

fn compare_map(prevention: &CollisionPrevention, outcome: &Outcome, step: &Value, report: &mut Report) {
    let (expect, map) = (&step["expect"], prevention.map());
    let fragile = indices(&step["fragile"], "map_bins");
    let [cm, time_us, range_cm, seen] =
        ["map_cm", "bin_time_us", "bin_max_range_cm", "bin_seen"].map(|name| unrolled(&expect[name]));
    for bin in 0..cm.len() {
        if fragile.contains(&bin) {
            report.pass_over(4);
            continue;
        }
        report.exact(
            "distance (cm)",
            (bin, i64::from(map.distance_cm[bin])),
            (bin, cm[bin]),
        );
        report.exact(
            "time of bin (us)",
            (bin, map.written_us[bin] as i64),
            (bin, time_us[bin]),
        );
        report.exact(
            "range of bin (cm)",
            (bin, i64::from(map.range_cm[bin])),
            (bin, range_cm[bin]),
        );
        report.exact("bin seen", (bin, i64::from(map.seen[bin])), (bin, seen[bin]));
    }
    if outcome.active {
        let fragile = indices(&step["fragile"], "published_bins");
        let published = expect.get("published_map_cm").map_or(cm, unrolled);
        for (bin, expected) in published.into_iter().enumerate() {
            if fragile.contains(&bin) {
                report.pass_over(1);
            } else {
                let ours = i64::from(prevention.published_cm()[bin]);
                report.exact("published (cm)", (bin, ours), (bin, expected));
            }
        }
    }
    report.exact(
        "map minimum (cm)",
        i64::from(map.min_cm),
        whole(&expect["map_min_cm"]),
    );
    report.exact(
        "map maximum (cm)",
        i64::from(map.max_cm),
        whole(&expect["map_max_cm"]),
    );
    report.exact("map time (us)", map.time_us as i64, whole(&expect["map_time_us"]));
    report.close("heading (rad)", prevention.yaw_rad(), number(&expect["yaw"]));
}

fn compare_outcome(outcome: &Outcome, step: &Value, report: &mut Report) {
    let expect = &step["expect"];
    let flag = |name: &str| flag(&expect[name]);
    report.exact("active", outcome.active, flag("active"));
    let bins_fragile = !indices(&step["fragile"], "map_bins").is_empty();
    if bins_fragile || step["fragile"]["setpoint"] == true {
        report.pass_over(1);
        return;
    }
    close_vector("setpoint", outcome.setpoint_mps2, &expect["setpoint_out"], report);
    if !outcome.active {
        return;
    }
    report.exact("data present", outcome.data_present, flag("data_present"));
    report.exact("warning", outcome.warns_of_no_data, flag("warn_no_data"));
    report.exact("hold", outcome.wants_hold, flag("hold_requested"));
    let unsupported = outcome.unsupported_frame.is_some();
    report.exact("unsupported frame", unsupported, flag("unsupported_frame"));
    report.close("closest (m)", outcome.closest_m, number(&expect["closest_m"]));
    close_vector(
        "closest direction",
        outcome.closest_direction,
        &expect["closest_dir"],
        report,
    );
    report.close(
        "distance to keep (m)",
        outcome.keep_m,
        number(&expect["min_keep_m"]),
    );
    report.exact(
        "steering",
        outcome.steering.is_some(),
        expect.get("guided_bin").is_some(),
    );
    let (Some(steering), Some(bin)) = (outcome.steering, expect.get("guided_bin")) else {
        return;
    };
    report.exact("guided bin", i64::from(steering.guidance.bin), whole(bin));
    close_vector(
        "guided direction",
        steering.guidance.direction,
        &expect["guided_dir"],
        report,
    );
    report.exact("feasible", steering.feasible, flag("feasible"));
    close_vector(
        "constrained",
        steering.constrained_mps2,
        &expect["constrained_accel"],
        report,
    );
    let braking = steering.braking;
    report.close(
        "braking",
        braking.acceleration_mps2,
        number(&expect["vel_comp_accel"]),
    );
    close_vector(
        "braking direction",
        braking.direction,
        &expect["vel_comp_dir"],
        report,
    );
}

fn compare_projection(reading: &DistanceSensor, attitude: [f32; 4], expected: &Value, report: &mut Report) {
    let ours = project(reading, attitude);
    report.close(
        "sensor yaw (rad)",
        ours.yaw_rad,
        number(&expected["sensor_yaw_rad"]),
    );
    report.close(
        "sensor yaw (deg)",
        ours.yaw_deg,
        number(&expected["sensor_yaw_deg_wrapped"]),
    );
    report.close("horizontal share", ours.scale, number(&expected["scale"]));
    let bin = |name: &str| expected[name].as_i64();
    let bins = ours.bins.map(|(first, last)| (i64::from(first), i64::from(last)));
    let expected = bin("lower_bin_unwrapped").zip(bin("upper_bin_unwrapped"));
    report.exact("bins of the field of view", bins, expected);
}

fn close_vector(what: &str, ours: Vector2<f32>, expected: &Value, report: &mut Report) {
    report.close(what, ours.x, number(&expected[0]));
    report.close(what, ours.y, number(&expected[1]));
}
