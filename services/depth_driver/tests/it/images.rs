//! Depth images of scenes that can be computed, and the tables of cameras that look at them.

use jink_depth_driver::config::SensorTable;
use jink_depth_driver::{DepthCameraDriver, DepthCameraSpec, Image};
use jink_shared_types::Timestamp;
use jink_shared_types::ranges::PointCloud;

/// A camera of `model` z16 with `keys`.
pub fn spec(keys: &str) -> DepthCameraSpec {
    let text = format!(
        "name = \"front\"\nkind = \"depth_camera\"\nmodel = \"z16\"\ndevice = \"/dev/video0\"\n{keys}"
    );
    let table: SensorTable = text.parse::<toml::Table>().unwrap().into_iter().collect();
    DepthCameraSpec::find(&[table], "front").unwrap()
}

/// A camera with a small image and one point for each pixel: pinhole, focal lengths 40 px, principal point (19.5,
/// 14.5).
pub fn small(keys: &str) -> DepthCameraSpec {
    with_bins(1, keys)
}

/// The same with one point for `bin_px` times `bin_px` pixels.
pub fn with_bins(bin_px: u16, keys: &str) -> DepthCameraSpec {
    spec(&format!(
        "width_px = 40\nheight_px = 30\nfx_px = 40\nfy_px = 40\ncx_px = 19.5\ncy_px = 14.5\nbin_px = {bin_px}\n{keys}"
    ))
}

/// Z16 as it lies in a buffer.
pub fn bytes(depths: &[u16]) -> Vec<u8> {
    depths.iter().flat_map(|depth| depth.to_le_bytes()).collect()
}

/// An image of these bytes without padding, captured 10 ms before it arrived at `ms`.
pub fn image<'a>(spec: &DepthCameraSpec, bytes: &'a [u8], sequence: u32, ms: u64) -> Image<'a> {
    Image {
        arrived: Timestamp::from_ns((1_000 + ms) * 1_000_000),
        stamp: Some(Timestamp::from_ns((990 + ms) * 1_000_000)),
        sequence,
        is_damaged: false,
        row_bytes: 2 * usize::from(spec.size_px[0]),
        bytes,
    }
}

/// The cloud of one image from a new driver.
pub fn cloud_of(spec: &DepthCameraSpec, depths: &[u16]) -> Box<PointCloud> {
    let mut driver = DepthCameraDriver::new(spec.clone());
    let mut cloud = PointCloud::boxed();
    let bytes = bytes(depths);
    driver.image(&image(spec, &bytes, 0, 0), &mut |view| view.write(&mut cloud));
    cloud
}
