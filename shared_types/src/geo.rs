//! Global and local coordinates: the azimuthal equidistant projection about the local origin, on a sphere, as PX4 uses it
//! (J. Snyder, "Map Projections: A Working Manual", USGS 1395, p. 195).

use nalgebra::Vector2;

/// Radius of the sphere (m).
const EARTH_RADIUS_M: f64 = 6_371_000.0;

/// A place on the globe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GlobalPoint {
    /// Latitude (deg).
    pub latitude_deg: f64,
    /// Longitude (deg).
    pub longitude_deg: f64,
}

impl GlobalPoint {
    /// From MAVLink's units of 1e-7 degrees.
    pub fn from_e7(latitude: i32, longitude: i32) -> Self {
        Self {
            latitude_deg: f64::from(latitude) * 1e-7,
            longitude_deg: f64::from(longitude) * 1e-7,
        }
    }

    /// Latitude and longitude in units of 1e-7 degrees.
    pub fn to_e7(self) -> (i32, i32) {
        let e7 = |deg: f64| (deg * 1e7).round() as i32;
        (e7(self.latitude_deg), e7(self.longitude_deg))
    }
}

/// The projection about one origin.
#[derive(Clone, Copy, Debug)]
pub struct Projection {
    latitude_rad: f64,
    longitude_rad: f64,
}

impl Projection {
    /// About `origin`.
    pub fn new(origin: GlobalPoint) -> Self {
        Self {
            latitude_rad: origin.latitude_deg.to_radians(),
            longitude_rad: origin.longitude_deg.to_radians(),
        }
    }

    /// North and east of the origin (m).
    pub fn to_local(&self, point: GlobalPoint) -> Vector2<f64> {
        let (sin_0, cos_0) = self.latitude_rad.sin_cos();
        let (sin_1, cos_1) = point.latitude_deg.to_radians().sin_cos();
        let (sin_d, cos_d) = (point.longitude_deg.to_radians() - self.longitude_rad).sin_cos();
        let north = cos_0 * sin_1 - sin_0 * cos_1 * cos_d;
        let east = cos_1 * sin_d;
        let sine = north.hypot(east);
        let arc = sine.atan2(sin_0 * sin_1 + cos_0 * cos_1 * cos_d);
        let scale = if sine > 0.0 { arc / sine } else { 1.0 };
        Vector2::new(north, east) * (scale * EARTH_RADIUS_M)
    }

    /// The place `local` metres north and east of the origin.
    pub fn to_global(&self, local: Vector2<f64>) -> GlobalPoint {
        let arc = local.norm() / EARTH_RADIUS_M;
        if arc <= 0.0 {
            return GlobalPoint {
                latitude_deg: self.latitude_rad.to_degrees(),
                longitude_deg: self.longitude_rad.to_degrees(),
            };
        }
        let direction = local.normalize();
        let (sin_0, cos_0) = self.latitude_rad.sin_cos();
        let (sin_c, cos_c) = arc.sin_cos();
        let latitude = (cos_c * sin_0 + direction.x * sin_c * cos_0).asin();
        let longitude =
            self.longitude_rad + (direction.y * sin_c).atan2(cos_0 * cos_c - direction.x * sin_0 * sin_c);
        GlobalPoint {
            latitude_deg: latitude.to_degrees(),
            longitude_deg: longitude.to_degrees(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn there_and_back_is_nowhere(
            latitude_deg in -70.0..70.0f64, longitude_deg in -179.0..179.0f64, x in -5e3..5e3f64, y in -5e3..5e3f64,
        ) {
            let projection = Projection::new(GlobalPoint { latitude_deg, longitude_deg });
            let there = projection.to_global(Vector2::new(x, y));
            prop_assert!((projection.to_local(there) - Vector2::new(x, y)).norm() < 1e-6);
        }
    }

    #[test]
    fn a_degree_of_latitude_is_a_degree_of_arc() {
        let projection = Projection::new(GlobalPoint {
            latitude_deg: 47.0,
            longitude_deg: 8.0,
        });
        let north = projection.to_local(GlobalPoint {
            latitude_deg: 48.0,
            longitude_deg: 8.0,
        });
        assert!((north.x - EARTH_RADIUS_M * 1f64.to_radians()).abs() < 1e-6);
        assert!(north.y.abs() < 1e-9);
    }
}
