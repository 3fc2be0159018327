//! A jink with a real depth camera, a file on FUSE in its device's place: a process for it is started and called by its name, its
//! clouds arrive, it is unplugged and plugged in again without a restart, and a mistake in its table is one line.

use crate::real_sensors::{assert_rendered, log, refusal};
use jink_runtime::{Instance, Session};
use jink_shared_types::ranges::{CloudPoint, PointCloud, RayKind};
use jink_shared_types::topics;
use jink_testkit::video_device::VideoDevice;
use jink_tests::ports::free_udp_port;
use jink_tests::processes::{System, TempFolder, until};
use std::sync::Arc;
use std::sync::atomic::{AtomicU16, Ordering};
use std::time::Duration;

const SIZE_PX: [u32; 2] = [64, 48];

fn depth_camera(device: &str, keys: &str) -> String {
    format!(
        "[[sensor]]\nname = \"front\"\nkind = \"depth_camera\"\nmodel = \"z16\"\ndevice = {device:?}\nwidth_px = 64\nheight_px = 48\n\
         fov_horizontal_deg = 87\nfov_vertical_deg = 58\nbin_px = 4\nrange_max_m = 8\n{keys}"
    )
}

#[test]
fn its_clouds_arrive_and_a_loose_plug_is_reported_and_survived() {
    let role = "depthcam";
    let Some(device) = VideoDevice::plug_in(role, SIZE_PX) else {
        return;
    };
    let device = Arc::new(device);
    let distance_mm = Arc::new(AtomicU16::new(3_000));
    let ended = Arc::new(AtomicU16::new(0));
    let (shown, wanted, over) = (Arc::clone(&device), Arc::clone(&distance_mm), Arc::clone(&ended));
    let capturing = std::thread::spawn(move || {
        for index in 0u16.. {
            if over.load(Ordering::Relaxed) > 0 {
                break;
            }
            // A wall whose last millimetre flickers, as with every real one.
            let depth = wanted.load(Ordering::Relaxed) + index % 2;
            let _free_buffer = shown.capture(&[depth; 64 * 48]);
            std::thread::sleep(Duration::from_millis(66));
        }
    });
    let folder = TempFolder::with_sensors(role, &depth_camera(&device.path(), "orientation = \"right\"\n"));
    let link = format!("udpin:127.0.0.1:{}", free_udp_port());
    let jink = System::up(role, &["--config", folder.text(), "--link", &link]);
    let instance: Instance = jink.instance().parse().unwrap();
    let session = Session::open(&instance, "cli").unwrap();
    let mut clouds = session
        .input::<PointCloud>(topics::RANGE_CLOUD, "front")
        .unwrap()
        .of_all_producers();
    // Whether a cloud has come since whose points all lie so far to the right (m), give or take the millimetre that flickers.
    let mut is_wall_at = |wanted_m: f32| {
        let mut seen = false;
        clouds.each(|cloud| {
            let points = cloud.sample.points();
            let is_there = |point: &CloudPoint| {
                point.kind.get() == RayKind::Hit && (point.right_m - wanted_m).abs() < 0.002
            };
            seen |= points.len() == 192 && cloud.sample.range_max_m == 8.0 && points.iter().all(is_there);
        });
        seen
    };
    until("a cloud", || is_wall_at(3.0));
    let before = jink.service("front");
    assert!(before["pid"].as_u64().is_some_and(|pid| pid > 0), "{before:#}");

    device.unplug();
    until("the loss", || {
        log(role, "front").contains("jink: depth camera front lost")
    });
    distance_mm.store(4_200, Ordering::Relaxed);
    device.replug();
    until("the return", || {
        log(role, "front").contains("jink: depth camera front back")
    });
    until("a cloud of the new stream", || is_wall_at(4.2));

    let after = jink.service("front");
    assert_eq!(
        (&after["pid"], &after["restarts"]),
        (&before["pid"], &0.into()),
        "{after:#}"
    );
    let text = log(role, "front");
    assert_eq!(
        text.matches("depth camera front lost").count(),
        1,
        "reported once: {text}"
    );
    assert!(
        text.contains("front: 192 points an image, one for each 4 x 4 pixels"),
        "{text}"
    );
    drop((clouds, session, jink));
    ended.store(1, Ordering::Relaxed);
    capturing.join().unwrap();
}

#[test]
fn a_mistake_in_its_table_is_one_line_that_says_what_is_possible() {
    let refused = refusal("depthno", &depth_camera("/dev/nothing", "flying_pixels = 1\n"));
    let said =
        "sensor \"front\": a depth_camera has no key `flying_pixels`; did you mean `flying_pixel_per_m`?";
    assert!(
        refused.starts_with("jink: cannot start: ") && refused.contains(said),
        "{refused}"
    );
}

#[test]
fn in_a_virtual_world_it_is_rendered_and_no_process_is_started_for_it() {
    let keys = "depth_scale_m = 0.001\nflying_pixel_per_m = 0.1\nborder_px = 0\n";
    assert_rendered("depthvirt", &depth_camera("/dev/nothing", keys));
}
