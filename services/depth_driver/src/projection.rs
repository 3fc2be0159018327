//! Where pixels look: a pinhole camera with the lens distortion of Brown and Conrady, as OpenCV has it.
//!
//! A direction is given by its slopes `x` (to the right) and `y` (down) over the depth along the optical axis. A pixel
//! in column `u` and row `v`, whose centre has these whole numbers as coordinates, shows the distorted slopes
//!
//! `u = fx x' + cx`, `v = fy y' + cy`, with `r^2 = x^2 + y^2`, `g = 1 + k1 r^2 + k2 r^4 + k3 r^6`,
//! `x' = x g + 2 p1 x y + p2 (r^2 + 2 x^2)`, `y' = y g + p1 (r^2 + 2 y^2) + 2 p2 x y`
//!
//! (OpenCV, "Camera Calibration and 3D Reconstruction"). The inverse is found by fixed-point iteration.

/// Iterations for the inverse: a wide lens with 20 % distortion needs some ten.
const ITERATIONS: usize = 40;
/// The inverse must lead back to its pixel as near as this (px): a fifth of the deviation of a disparity.
const BACK_WITHIN_PX: f64 = 0.02;

/// Focal lengths and principal point (px).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Focal length, horizontal.
    pub fx_px: f64,
    /// Focal length, vertical.
    pub fy_px: f64,
    /// Column of the principal point.
    pub cx_px: f64,
    /// Row of the principal point.
    pub cy_px: f64,
}

impl Intrinsics {
    /// Of an image with square edges at `fov_deg` (horizontal, vertical; the whole angle, deg) and its principal point
    /// in the middle.
    pub fn of_fov([width_px, height_px]: [u16; 2], fov_deg: [f64; 2]) -> Self {
        let focal_px = |size_px: u16, deg: f64| 0.5 * f64::from(size_px) / (0.5 * deg.to_radians()).tan();
        Self {
            fx_px: focal_px(width_px, fov_deg[0]),
            fy_px: focal_px(height_px, fov_deg[1]),
            cx_px: 0.5 * (f64::from(width_px) - 1.0),
            cy_px: 0.5 * (f64::from(height_px) - 1.0),
        }
    }
}

/// Coefficients of the distortion, without unit; all zero: none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distortion {
    /// Radial, second order.
    pub k1: f64,
    /// Radial, fourth order.
    pub k2: f64,
    /// Tangential.
    pub p1: f64,
    /// Tangential.
    pub p2: f64,
    /// Radial, sixth order.
    pub k3: f64,
}

impl Distortion {
    /// The slopes at which a direction with slopes `x` and `y` appears.
    pub fn distort(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let squared = x * x + y * y;
        let gain = 1.0 + squared * (self.k1 + squared * (self.k2 + squared * self.k3));
        [
            x * gain + 2.0 * self.p1 * x * y + self.p2 * (squared + 2.0 * x * x),
            y * gain + self.p1 * (squared + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        ]
    }

    /// The slopes that appear at `seen`; `None` where iteration finds none within `tolerance`.
    fn undistort(&self, seen: [f64; 2], tolerance: [f64; 2]) -> Option<[f64; 2]> {
        let mut slopes = seen;
        for _ in 0..ITERATIONS {
            let [x, y] = self.distort(slopes);
            slopes = [slopes[0] + seen[0] - x, slopes[1] + seen[1] - y];
        }
        let [x, y] = self.distort(slopes);
        // False for NaN, too.
        let is_back = (x - seen[0]).abs() <= tolerance[0] && (y - seen[1]).abs() <= tolerance[1];
        is_back.then_some(slopes)
    }
}

/// The slopes of every pixel, row by row from the upper left.
#[derive(Clone, Debug, PartialEq)]
pub struct Projection {
    slopes: Vec<[f32; 2]>,
}

impl Projection {
    /// For an image of `size_px` (width, height), of which the outer `border_px` are not used.
    ///
    /// # Errors
    /// Column and row of the first used pixel whose distortion has no inverse.
    pub fn new(
        size_px: [u16; 2],
        border_px: u16,
        intrinsics: &Intrinsics,
        distortion: &Distortion,
    ) -> Result<Self, [u16; 2]> {
        let [width_px, height_px] = size_px;
        let tolerance = [
            BACK_WITHIN_PX / intrinsics.fx_px,
            BACK_WITHIN_PX / intrinsics.fy_px,
        ];
        let is_used = |place: u16, size: u16| place >= border_px && place < size.saturating_sub(border_px);
        let mut slopes = Vec::with_capacity(usize::from(width_px) * usize::from(height_px));
        for row in 0..height_px {
            for column in 0..width_px {
                let seen = [
                    (f64::from(column) - intrinsics.cx_px) / intrinsics.fx_px,
                    (f64::from(row) - intrinsics.cy_px) / intrinsics.fy_px,
                ];
                let found = if *distortion == Distortion::default() {
                    Some(seen)
                } else {
                    distortion.undistort(seen, tolerance)
                };
                match found {
                    Some([x, y]) => slopes.push([x as f32, y as f32]),
                    None if is_used(column, width_px) && is_used(row, height_px) => {
                        return Err([column, row]);
                    }
                    None => slopes.push([0.0; 2]),
                }
            }
        }
        Ok(Self { slopes })
    }

    /// Slopes to the right and down of pixel number `pixel`; those of the optical axis if there is no such pixel.
    #[inline]
    pub fn slopes(&self, pixel: usize) -> [f32; 2] {
        self.slopes.get(pixel).copied().unwrap_or_default()
    }
}
