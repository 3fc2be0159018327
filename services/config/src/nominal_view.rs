//! What a sensor looks at by its data sheet: for models that do not say where they got no answer, so that nobody learns it from their
//! answers in the open.
//!
//! | in | out |
//! |---|---|
//! | model and mounting of a `[[sensor]]` table | its nominal [`FieldOfView`] |

use crate::sensor_table::{SensorKeys, SensorTable};
use jink_shared_types::view::FieldOfView;
use nalgebra::Vector3;
use toml::Value;

/// The shape of a field of view, angles to the outermost rays (deg).
#[derive(Clone, Copy, Debug)]
enum Shape {
    /// All around, or so far to both sides together, between a lowest and a highest elevation.
    Sector { around: f64, up: [f64; 2] },
    /// An image of this width and height.
    Image([f64; 2]),
}

/// Livox user manuals; Intel's data sheet of the D400 family (337029) for images of 16:9.
const MODELS: [(&str, Shape); 5] = [
    (
        "livox_mid360",
        Shape::Sector {
            around: 360.0,
            up: [-7.0, 52.0],
        },
    ),
    (
        "livox_avia",
        Shape::Sector {
            around: 70.4,
            up: [-38.6, 38.6],
        },
    ),
    ("realsense_d435", Shape::Image([87.0, 58.0])),
    ("realsense_d455", Shape::Image([87.0, 58.0])),
    ("realsense_d415", Shape::Image([65.0, 40.0])),
];

/// Rays to each side by which a field of view is drawn: denser than its bins are wide.
const RAYS: usize = 180;

/// The directions (body) at which the sensor of that table looks; empty where its model says where it got no answer, or is not known.
pub(crate) fn nominal_view(sensor: &str, table: &SensorTable) -> FieldOfView {
    let mut view = FieldOfView::default();
    let model = table.get("model").and_then(Value::as_str);
    let known = MODELS.iter().find(|(name, _)| Some(*name) == model);
    let mounting = SensorKeys { sensor, table }.mounting().ok();
    let Some(((_, shape), body_q_sensor)) = known.zip(mounting.and_then(|mounting| mounting.rotation()))
    else {
        return view;
    };
    for column in 0..RAYS {
        for row in 0..RAYS {
            let [aside, up] = [column, row].map(|ray| (ray as f64 + 0.5) / RAYS as f64);
            view.add(&(body_q_sensor * shape.ray(aside, up)));
        }
    }
    view
}

impl Shape {
    /// The ray (sensor frame) at these shares of width and height.
    fn ray(self, aside: f64, up: f64) -> Vector3<f64> {
        match self {
            Self::Sector {
                around,
                up: [low, high],
            } => {
                let (right_sin, right_cos) = (around * (aside - 0.5)).to_radians().sin_cos();
                let (up_sin, up_cos) = (low + (high - low) * up).to_radians().sin_cos();
                Vector3::new(up_cos * right_cos, up_cos * right_sin, -up_sin)
            }
            Self::Image(size) => {
                let [width, height] = size.map(|deg| 2.0 * (0.5 * deg).to_radians().tan());
                Vector3::new(1.0, width * (aside - 0.5), -height * (up - 0.5))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::nominal_view;
    use crate::sensor_table::SensorTable;
    use jink_shared_types::view::{FieldOfView, Missing, Needs};

    const NEEDS: Needs = Needs {
        clearance_m: 0.7,
        start_bubble_m: 0.9,
        no_overhang: true,
        is_landed: false,
    };

    fn of(text: &str) -> FieldOfView {
        let table: SensorTable = toml::from_str(text).unwrap();
        FieldOfView {
            far_m: 12.0,
            ..nominal_view("front", &table)
        }
    }

    #[test]
    fn the_nominal_field_of_view_is_that_of_the_data_sheet_as_it_is_mounted() {
        let mid360 = of("model = \"livox_mid360\"");
        assert!(mid360.is_all_around() && mid360.is_high());
        assert_eq!(mid360.missing(&NEEDS), None);
        let inverted = of("model = \"livox_mid360\"\nroll_deg = 180");
        assert!(inverted.is_all_around() && !inverted.is_high());
        let camera = of("model = \"realsense_d435\"");
        assert_eq!(
            camera.aside_rad().map(|rad| rad.to_degrees().round()),
            [45.0, 45.0]
        );
        let aside = of("model = \"realsense_d435\"\nyaw_deg = 90");
        assert!(!aside.is_level_seen(0) && aside.is_level_seen(18));
        assert_eq!(
            of("model = \"realsense_d435\"\npitch_deg = -90").missing(&NEEDS),
            Some(Missing::Ahead)
        );
        assert!(of("model = \"vlp16\"").is_empty() && of("").is_empty());
    }
}
