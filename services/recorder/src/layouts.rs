//! What the recorder needs to know of payloads that it only copies.

use jink_shared_types::layout::Layout as SampleLayout;
use jink_shared_types::shape::Shape;
use jink_shared_types::topics::{self, Topic, TopicRow, Visitor};
use std::fmt::Debug;

/// The layout of a payload, as far as it matters for copying it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Layout {
    /// Where a payload that ends in a list says how many elements are in use (a `u32` called `len`), where the list begins, and bytes of
    /// each element.
    list: Option<[usize; 3]>,
}

impl Layout {
    /// Of the payloads of a row; of one that the configuration declares nothing is known.
    pub fn of(row: &TopicRow) -> Self {
        topics::visit(row, LayoutOf).unwrap_or_default()
    }

    /// How many bytes of a payload say something: those behind the last element in use are of older samples.
    pub fn used_bytes(&self, payload: &[u8]) -> usize {
        let used = |[len, begin, element]: [usize; 3]| {
            let count = payload.get(len..len + 4)?.try_into().ok()?;
            let elements = (u32::from_le_bytes(count) as usize).checked_mul(element)?;
            Some(begin.checked_add(elements)?.min(payload.len()))
        };
        self.list.and_then(used).unwrap_or(payload.len())
    }
}

struct LayoutOf;
impl Visitor for LayoutOf {
    type Output = Layout;
    fn visit<T: SampleLayout + Debug + 'static>(self, _: Topic<T>) -> Layout {
        let list = || {
            let Shape::Struct(shape) = T::SHAPE else {
                return None;
            };
            let len = shape
                .fields
                .iter()
                .find(|field| field.name == "len" && field.size == 4)?;
            let last = shape.fields.last()?;
            match last.shape {
                Shape::Array { len: elements, .. } => Some([len.offset, last.offset, last.size / elements]),
                _ => None,
            }
        };
        Layout { list: list() }
    }
}

#[cfg(test)]
mod tests {
    use super::Layout;
    use jink_shared_types::ranges::PointCloud;
    use jink_shared_types::topics::{RANGE_CLOUD, VEHICLE_STATE};
    use std::mem::{offset_of, size_of};

    #[test]
    fn the_unused_end_of_a_cloud_is_not_kept() {
        let mut cloud = vec![0xff; size_of::<PointCloud>()];
        let layout = Layout::of(&RANGE_CLOUD.row);
        assert_eq!(layout.used_bytes(&cloud), cloud.len(), "nonsense is kept whole");
        cloud[offset_of!(PointCloud, len)..][..4].copy_from_slice(&3u32.to_le_bytes());
        assert_eq!(layout.used_bytes(&cloud), offset_of!(PointCloud, points) + 3 * 16);
        assert_eq!(layout.used_bytes(&[]), 0);
        assert_eq!(Layout::of(&VEHICLE_STATE.row).used_bytes(&[1; 192]), 192);
    }
}
