//! What an image costs from its bytes to its cloud: percentiles over a synthetic scene with noise, holes and edges.
//!
//! `cargo run --release -p jink-depth-driver --example image_cost`
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a benchmark that cannot do its work ends"
)]

use jink_depth_driver::config::SensorTable;
use jink_depth_driver::{DepthCameraDriver, DepthCameraSpec, Image};
use jink_shared_types::Timestamp;
use jink_shared_types::quantile::quantiles;
use jink_shared_types::ranges::PointCloud;
use std::time::Instant;

const IMAGES: u32 = 600;

fn main() {
    for (size_px, keys) in [
        ([640u16, 480u16], ""),
        ([848, 480], ""),
        ([848, 480], "bin_px = 3\n"),
        ([848, 480], "flying_pixel_per_m = 0\n"),
        ([1280, 720], ""),
    ] {
        let text = format!(
            "name = \"front\"\nkind = \"depth_camera\"\nmodel = \"z16\"\ndevice = \"/dev/video0\"\nwidth_px = {}\nheight_px = {}\n\
             fov_horizontal_deg = 87\nfov_vertical_deg = 58\n{keys}",
            size_px[0], size_px[1]
        );
        let table: SensorTable = text.parse::<toml::Table>().unwrap().into_iter().collect();
        let spec = DepthCameraSpec::find(&[table], "front").unwrap();
        let images: Vec<Vec<u8>> = (0..8).map(|seed| scene(size_px, seed)).collect();
        let mut driver = DepthCameraDriver::new(spec.clone());
        let mut cloud = PointCloud::boxed();
        let us: Vec<f64> = (0..IMAGES)
            .map(|index| {
                let bytes = &images[index as usize % images.len()];
                let arrived = Timestamp::from_ns(u64::from(index + 1) * 33_000_000);
                let image = Image {
                    arrived,
                    stamp: Some(arrived),
                    sequence: index,
                    is_damaged: false,
                    row_bytes: 2 * usize::from(size_px[0]),
                    bytes,
                };
                let begin = Instant::now();
                driver.image(&image, &mut |view| view.write(&mut cloud));
                begin.elapsed().as_secs_f64() * 1e6
            })
            .collect();
        let [p50, p99, max] = quantiles(&us, [0.5, 0.99, 1.0]).unwrap_or_default();
        println!(
            "{} x {} {:24} {:6} points: {p50:6.0} / {p99:6.0} / {max:6.0} us (p50 / p99 / max)",
            size_px[0],
            size_px[1],
            keys.trim(),
            spec.points()
        );
    }
}

/// Ground, a wall with holes in it, and a post, with noise that grows with the square of the depth.
fn scene([width, height]: [u16; 2], seed: u64) -> Vec<u8> {
    let mut state = seed + 1;
    let mut random = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut bytes = Vec::new();
    for row in 0..height {
        for column in 0..width {
            let down = (f64::from(row) / f64::from(height) - 0.5) * 1.1;
            let ground_m = if down > 0.0 { 1.5 / down } else { f64::INFINITY };
            let post_m = if column / 60 % 4 == 1 { 2.0 } else { f64::INFINITY };
            let z_m = ground_m.min(post_m).min(8.0);
            let noisy_m = z_m + 0.0036 * z_m * z_m * (random() + random() + random() - 1.5) * 2.0;
            let depth = if random() < 0.08 {
                0
            } else {
                (noisy_m * 1e3) as u16
            };
            bytes.extend(depth.to_le_bytes());
        }
    }
    bytes
}
