//! The models: the figures that their vendors publish.
//!
//! Fields of view are those of Intel's datasheet of the D400 family (337029) for images of 16:9. Noise and shortest
//! depth follow from the geometry of a stereo pair as "Tuning depth cameras for best performance" (Intel) has them: a
//! depth `z` has the deviation `z^2 * s / (f * b)` with the deviation `s` of the disparity, focal length `f` (both px)
//! and baseline `b`, and nothing nearer than `f * b / 126` is matched.

/// Deviation of a disparity (px): 0.08, Intel's figure for a well textured wall. Less texture makes it several times as
/// large.
pub const DISPARITY_SIGMA_PX: f64 = 0.08;
/// Largest disparity that a D400 looks for (px).
pub const DISPARITY_MAX_PX: f64 = 126.0;

/// One model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthCameraModel {
    /// Name in the configuration.
    pub name: &'static str,
    /// Width and height of the image that is requested by default (px).
    pub size_px: [u16; 2],
    /// Horizontal and vertical field of view of images of 16:9 (deg).
    pub fov_deg: Option<[f64; 2]>,
    /// Distance between the two imagers (m).
    pub baseline_m: Option<f64>,
    /// Default maximum range (m): of the D400s where one deviation is 0.1 m, the map's own error.
    pub range_max_m: f64,
}

/// Every model.
pub const TABLE: &[DepthCameraModel] = &[
    DepthCameraModel {
        name: "realsense_d435",
        size_px: [848, 480],
        fov_deg: Some([87.0, 58.0]),
        baseline_m: Some(0.050),
        range_max_m: 5.0,
    },
    DepthCameraModel {
        name: "realsense_d455",
        size_px: [848, 480],
        fov_deg: Some([87.0, 58.0]),
        baseline_m: Some(0.095),
        range_max_m: 7.0,
    },
    DepthCameraModel {
        name: "realsense_d415",
        size_px: [848, 480],
        fov_deg: Some([65.0, 40.0]),
        baseline_m: Some(0.055),
        range_max_m: 6.0,
    },
    DepthCameraModel {
        name: "z16",
        size_px: [640, 480],
        fov_deg: None,
        baseline_m: None,
        range_max_m: 4.0,
    },
];

/// The model called `name`.
pub fn find(name: &str) -> Option<&'static DepthCameraModel> {
    TABLE.iter().find(|model| model.name == name)
}

/// The names of all models, as a sentence lists them.
pub fn names() -> String {
    TABLE
        .iter()
        .map(|model| model.name)
        .collect::<Vec<_>>()
        .join(", ")
}
