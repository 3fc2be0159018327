//! Sensors that can be bought, by the name that their driver knows them by (`model`): what the maker's data sheet says of field of
//! view, rays, range and noise takes the place of the kind's defaults.
//!
//! Of an Ouster the model with fewer rows is rendered unless the table says more (`rings`, `beams`); of a depth camera what its driver
//! leaves of an image. A real one says of a ray without an answer no more than that: it is [`super::head::Answer::Unknown`] unless the table
//! declares `no_return = "clear"`. What answers from beyond `range_max_m`, up to `answers_m`, says that nothing is nearer.
//! Lidars lose dark and grazing surfaces and take the sun for an answer now and then; cameras lose what is smeared while they turn,
//! grazing surfaces, and what is near the sun.

use super::kind::SensorKind;
use super::spec::{NoReturn, SensorSpec};

/// How a lidar's rays are spread over its field of view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pattern {
    /// Evenly over the solid angle, never the same again.
    Even,
    /// Rings that turn together: columns of rays one after the other.
    Rings,
    /// Four lines side by side that swing up and down while they turn, as a Mid-360 looks around; never the same again.
    Swing,
    /// A flower of two prisms that turn at different rates; never the same again.
    Rosette,
}

/// What a product has instead of its kind's defaults.
pub(super) struct Product {
    /// The name that its driver knows it by.
    pub model: &'static str,
    /// What it is rendered as.
    pub kind: SensorKind,
    pub pattern: Pattern,
    /// How far a wall of light colour answers (m).
    pub answers_m: f64,
    /// Puts what the table leaves open.
    fill: fn(&mut SensorSpec),
}

const PRODUCTS: [Product; 9] = [
    // Livox Mid-360 user manual v1.2.
    Product {
        model: "livox_mid360",
        kind: SensorKind::Lidar3d,
        pattern: Pattern::Swing,
        answers_m: 70.0,
        fill: |spec| {
            spec.elevation_min_deg.get_or_insert(-7.0);
            spec.elevation_max_deg.get_or_insert(52.0);
            spec.range_max_m.get_or_insert(40.0);
        },
    },
    // Livox Avia user manual v1.2.
    Product {
        model: "livox_avia",
        kind: SensorKind::Lidar3d,
        pattern: Pattern::Rosette,
        answers_m: 320.0,
        fill: |spec| {
            spec.fov_horizontal_deg.get_or_insert(70.4);
            spec.elevation_min_deg.get_or_insert(-38.6);
            spec.elevation_max_deg.get_or_insert(38.6);
            spec.rays.get_or_insert(24_000);
            spec.range_min_m.get_or_insert(1.0);
            spec.range_max_m.get_or_insert(190.0);
        },
    },
    // Ouster OS0 data sheet, rev. 7.
    Product {
        model: "ouster_os0",
        kind: SensorKind::Lidar3d,
        pattern: Pattern::Rings,
        answers_m: 75.0,
        fill: |spec| {
            spec.elevation_min_deg.get_or_insert(-45.0);
            spec.elevation_max_deg.get_or_insert(45.0);
            spec.rings.get_or_insert(64);
            spec.beams.get_or_insert(512);
            spec.range_min_m.get_or_insert(0.3);
            spec.range_max_m.get_or_insert(35.0);
        },
    },
    // Ouster OS1 data sheet, rev. 7.
    Product {
        model: "ouster_os1",
        kind: SensorKind::Lidar3d,
        pattern: Pattern::Rings,
        answers_m: 170.0,
        fill: |spec| {
            spec.elevation_min_deg.get_or_insert(-22.5);
            spec.elevation_max_deg.get_or_insert(22.5);
            spec.rings.get_or_insert(32);
            spec.beams.get_or_insert(512);
            spec.range_min_m.get_or_insert(0.3);
            spec.range_max_m.get_or_insert(90.0);
            spec.sigma_m.get_or_insert(0.015);
        },
    },
    // Velodyne VLP-16 user manual, 63-9243 rev. E.
    Product {
        model: "vlp16",
        kind: SensorKind::Lidar3d,
        pattern: Pattern::Rings,
        answers_m: 100.0,
        fill: |spec| {
            spec.elevation_min_deg.get_or_insert(-15.0);
            spec.elevation_max_deg.get_or_insert(15.0);
            spec.rings.get_or_insert(16);
            spec.beams.get_or_insert(900);
            spec.rate_hz.get_or_insert(20.0);
            spec.range_min_m.get_or_insert(0.5);
            spec.range_max_m.get_or_insert(100.0);
            spec.sigma_m.get_or_insert(0.03);
        },
    },
    // Intel RealSense D400 data sheet.
    Product {
        model: "realsense_d435",
        kind: SensorKind::DepthCamera,
        pattern: Pattern::Even,
        answers_m: 20.0,
        fill: |spec| {
            spec.fov_horizontal_deg.get_or_insert(87.0);
            spec.fov_vertical_deg.get_or_insert(58.0);
            spec.width_px.get_or_insert(120);
            spec.height_px.get_or_insert(68);
            spec.range_min_m.get_or_insert(0.3);
            spec.range_max_m.get_or_insert(10.0);
            // Subpixel error 0.05 px, focal length 424 px, baseline 5 cm.
            spec.sigma_per_m.get_or_insert(0.0025);
        },
    },
    // LightWare SF45/B product guide.
    Product {
        model: "sf45b",
        kind: SensorKind::Lidar2d,
        pattern: Pattern::Even,
        answers_m: 50.0,
        fill: |spec| {
            let low_deg = spec.scan_low_deg.unwrap_or(-160.0);
            let high_deg = spec.scan_high_deg.unwrap_or(160.0);
            spec.fov_horizontal_deg.get_or_insert(high_deg - low_deg);
            // Its driver takes a lost signal for nothing in range, as both autopilots do.
            spec.no_return.get_or_insert(NoReturn::Clear);
            spec.beams.get_or_insert(640);
            spec.rate_hz.get_or_insert(5.0);
            spec.range_min_m.get_or_insert(0.2);
            spec.range_max_m.get_or_insert(50.0);
            spec.sigma_m.get_or_insert(0.03);
        },
    },
    // SLAMTEC RPLIDAR S2 data sheet.
    Product {
        model: "rplidar_s2",
        kind: SensorKind::Lidar2d,
        pattern: Pattern::Even,
        answers_m: 30.0,
        fill: |spec| {
            spec.beams.get_or_insert(1_000);
            spec.range_min_m.get_or_insert(0.05);
            spec.range_max_m.get_or_insert(30.0);
            spec.sigma_m.get_or_insert(0.03);
        },
    },
    // LDROBOT LD19 data sheet.
    Product {
        model: "ld19",
        kind: SensorKind::Lidar2d,
        pattern: Pattern::Even,
        answers_m: 12.0,
        fill: |spec| {
            spec.beams.get_or_insert(450);
            spec.range_min_m.get_or_insert(0.05);
        },
    },
];

/// The product that the table of `spec` names, if it is rendered as one; a model that only a driver knows is none.
pub(super) fn product(spec: &SensorSpec) -> Option<&'static Product> {
    let model = spec.model.as_deref()?;
    PRODUCTS.iter().find(|product| product.model == model)
}

/// The table with all that the product adds to it.
pub(super) fn filled(spec: &SensorSpec) -> SensorSpec {
    let mut filled = spec.clone();
    if let Some(product) = product(spec) {
        filled.kind = product.kind;
        (product.fill)(&mut filled);
    }
    filled
}
