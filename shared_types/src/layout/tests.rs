use super::{Layout, type_name};

mod one {
    crate::wire_enum! {
        /// What a ray met.
        pub enum Met {
            /// Not known.
            Unknown = 0 "unknown",
            /// An obstacle.
            Hit = 1 "hit",
            /// Nothing.
            Clear = 2 "clear",
        }
    }
    const CELL_M: f64 = 0.2;
    crate::sample! {
        /// What other builds are compared with.
        #[derive(Clone, Copy, Debug)]
        pub struct Ray: 32 {
            /// How far.
            pub cells: u64,
            /// What it met there.
            pub met: crate::Coded<Met>,
            /// Explicit padding, zero.
            pub reserved: crate::Reserved<7>,
            /// Room for later fields, zero.
            pub reserved_tail: crate::Reserved<16>,
        }
        means { CELL_M: f64 }
    }
}

/// Declares the same sample as another build has it.
macro_rules! build {
    ($module:ident, $cell_m:literal, hit $hit:literal, clear $clear:literal, $($field:ident: $type:ty),*) => {
        mod $module {
            crate::wire_enum! {
                /// What a ray met.
                pub enum Met {
                    /// Not known.
                    Unknown = 0 "unknown",
                    /// An obstacle.
                    Hit = $hit "hit",
                    /// Nothing.
                    Clear = $clear "clear",
                }
            }
            const CELL_M: f64 = $cell_m;
            crate::sample! {
                /// The same sample of another build.
                #[derive(Clone, Copy, Debug)]
                pub struct Ray: 32 { $(
                    /// A field.
                    pub $field: $type,
                )* }
                means { CELL_M: f64 }
            }
        }
    };
}
build!(codes_swapped, 0.2, hit 2, clear 1,
    cells: u64, met: crate::Coded<Met>, reserved: crate::Reserved<7>, reserved_tail: crate::Reserved<16>);
build!(finer_cells, 0.1, hit 1, clear 2,
    cells: u64, met: crate::Coded<Met>, reserved: crate::Reserved<7>, reserved_tail: crate::Reserved<16>);
build!(fields_moved, 0.2, hit 1, clear 2,
    met: crate::Coded<Met>, reserved: crate::Reserved<7>, cells: u64, reserved_tail: crate::Reserved<16>);
build!(field_added, 0.2, hit 1, clear 2,
    cells: u64, met: crate::Coded<Met>, channel: crate::Added<u8>, reserved: crate::Reserved<6>,
    intensity: crate::Added<f64>, reserved_tail: crate::Reserved<8>);
build!(field_renamed, 0.2, hit 1, clear 2,
    steps: u64, met: crate::Coded<Met>, reserved: crate::Reserved<7>, reserved_tail: crate::Reserved<16>);

#[test]
fn an_exchanged_code_changes_the_type_name() {
    assert_ne!(type_name::<one::Ray>(), type_name::<codes_swapped::Ray>());
}

#[test]
fn a_constant_that_the_numbers_depend_on_changes_the_type_name() {
    assert_ne!(type_name::<one::Ray>(), type_name::<finer_cells::Ray>());
}

#[test]
fn a_moved_or_renamed_field_changes_the_type_name() {
    assert_ne!(type_name::<one::Ray>(), type_name::<fields_moved::Ray>());
    assert_ne!(type_name::<one::Ray>(), type_name::<field_renamed::Ray>());
}

#[test]
fn a_field_in_reserved_room_does_not_change_the_type_name() {
    assert_eq!(type_name::<one::Ray>(), type_name::<field_added::Ray>());
}

#[test]
fn the_type_name_carries_the_hash() {
    let name = type_name::<one::Ray>();
    assert_eq!(name, format!("jink.Ray#{:016x}", one::Ray::LAYOUT_HASH));
}

#[test]
fn array_length_and_element_matter() {
    assert_ne!(<[u8; 4]>::LAYOUT_HASH, <[u8; 5]>::LAYOUT_HASH);
    assert_ne!(<[u32; 4]>::LAYOUT_HASH, <[f32; 4]>::LAYOUT_HASH);
}
