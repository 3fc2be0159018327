//! Laws of the filter: what hangs between two surfaces goes, what is a surface of 2 x 2 pixels stays.

use jink_depth_driver::flying::FlyingPixelFilter;
use proptest::prelude::*;

const WIDTH: usize = 24;
const HEIGHT: usize = 16;
const PER_M: f64 = 0.02;

fn filtered(depths: &[u16]) -> (Vec<u16>, usize) {
    let mut out = depths.to_vec();
    let removed = FlyingPixelFilter::new(WIDTH, PER_M, 0.001).remove(&mut out);
    (out, removed)
}

/// Whether two depths (mm) may lie on one surface, in the precision of the filter.
fn is_one_surface(a: u16, b: u16) -> bool {
    let (a, b) = (f64::from(a), f64::from(b));
    let apart = (a - b).abs();
    apart <= 2.0 || apart <= PER_M * 1e-3 * a * b * 1.001
}

proptest! {
    #[test]
    fn between_two_surfaces_nothing_is_left_hanging(
        near in 300u16..3_000,
        gap in 1.3..4.0f64,
        edge in 2usize..WIDTH - 3,
        between in prop::collection::vec(0.1..0.9f64, HEIGHT),
        is_upright in any::<bool>(),
    ) {
        let far = (f64::from(near) * gap) as u16;
        // The image as it is seen, with the edge along a column; turned, it lies along a row.
        let depth = |row: usize, column: usize| {
            let mixed = f64::from(near) + between[row % HEIGHT] * f64::from(far - near);
            match column.cmp(&edge) {
                std::cmp::Ordering::Less => near,
                std::cmp::Ordering::Equal => mixed as u16,
                std::cmp::Ordering::Greater => far,
            }
        };
        let edge_row = edge % (HEIGHT - 4) + 2;
        let lying = |row: usize, column: usize| depth(column, if row == edge_row { edge } else if row < edge_row { 0 } else { WIDTH - 1 });
        let image: Vec<u16> = (0..WIDTH * HEIGHT)
            .map(|pixel| (pixel / WIDTH, pixel % WIDTH))
            .map(|(row, column)| if is_upright { depth(row, column) } else { lying(row, column) })
            .collect();
        let (out, _) = filtered(&image);
        for (pixel, (before, after)) in image.iter().zip(&out).enumerate() {
            let hangs = !is_one_surface(*before, near) && !is_one_surface(*before, far);
            if hangs && *after != 0 {
                // A square of its own with neighbours along the edge makes it a surface only if it has two columns; it
                // has one.
                prop_assert!(false, "pixel {pixel}: {before} between {near} and {far}");
            }
            if *before == near || *before == far {
                prop_assert_eq!(before, after, "pixel {} of a surface", pixel);
            }
        }
    }

    #[test]
    fn a_surface_of_two_by_two_pixels_stays_whatever_is_around_it(
        around in prop::collection::vec(any::<u16>(), WIDTH * HEIGHT),
        row in 0..HEIGHT - 1,
        column in 0..WIDTH - 1,
        depth in 100u16..20_000,
        share in prop::array::uniform4(0.0..0.99f64),
    ) {
        let mut image = around;
        let corner = row * WIDTH + column;
        // The greatest depth `b` above `a` with 1/a - 1/b = k.
        let room = (PER_M * 1e-3 * f64::from(depth).powi(2)).min(2_000.0);
        let square = [corner, corner + 1, corner + WIDTH, corner + WIDTH + 1];
        for (pixel, share) in square.into_iter().zip(share) {
            image[pixel] = depth + (share * room) as u16;
        }
        let (out, _) = filtered(&image);
        for pixel in square {
            prop_assert_eq!(out[pixel], image[pixel]);
        }
    }

    #[test]
    fn nothing_appears_and_nothing_moves(
        width in 1usize..40,
        image in prop::collection::vec(any::<u16>(), 0..900),
        per_m in 0.0..10.0f64,
        scale_m in 1e-6..0.1f64,
    ) {
        let mut out = image.clone();
        let removed = FlyingPixelFilter::new(width, per_m, scale_m).remove(&mut out);
        let changed = image.iter().zip(&out).filter(|(before, after)| before != after);
        prop_assert_eq!(changed.clone().count(), removed);
        for (_, after) in changed {
            prop_assert_eq!(*after, 0);
        }
    }
}

#[test]
fn ground_that_is_looked_at_at_a_grazing_angle_stays_up_to_the_horizon() {
    // Camera 0.5 m above level ground, focal length 447 px, rows below the horizon: 1/z grows by 1/(447 * 0.5) a row,
    // 0.0045 per m.
    let image: Vec<u16> = (0..WIDTH * HEIGHT)
        .map(|pixel| (447.0 * 500.0 / (4 + pixel / WIDTH) as f64) as u16)
        .collect();
    assert_eq!(filtered(&image), (image.clone(), 0));
}

#[test]
fn the_noise_of_a_d435_removes_nothing_of_a_wall_worth_mentioning() {
    // Deviation 0.0036 z^2, from uniform numbers summed up (Irwin and Hall).
    let mut state = 7u64;
    let mut uniform = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let (mut pixels, mut removed) = (0, 0);
    for z_m in [0.5, 1.0, 2.0, 4.0, 6.0] {
        for _ in 0..50 {
            let image: Vec<u16> = (0..WIDTH * HEIGHT)
                .map(|_| {
                    let normal = (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
                    (1e3 * (z_m + normal * 0.0036 * z_m * z_m)).round() as u16
                })
                .collect();
            pixels += image.len();
            removed += filtered(&image).1;
        }
    }
    println!("{removed} of {pixels} pixels");
    assert!(removed * 1_000 < pixels, "{removed} of {pixels}");
}
