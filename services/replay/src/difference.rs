//! Where two samples of one topic differ.

use jink_shared_types::SampleHeader;
use jink_shared_types::layout::{Layout, bytes_of};
use jink_shared_types::shape::{Number, Shape, StructShape};
use jink_shared_types::topics::{self, TABLE, Topic, Visitor};
use std::fmt;

/// The first field in which two samples differ.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FieldDifference {
    /// Its name, with those of what it is a part of: `curves.2.points.0.x`.
    pub field: String,
    /// As it was recorded.
    pub recorded: String,
    /// As it is now.
    pub replayed: String,
}

impl fmt::Display for FieldDifference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            field,
            recorded,
            replayed,
        } = self;
        write!(f, "{field}: {recorded} was recorded, now it is {replayed}")
    }
}

/// The first difference of two payloads of `topic`, if there is one: what lies behind the end of a list, and what is kept for later
/// fields, is not looked at.
pub fn of_payloads(topic: &str, recorded: &[u8], replayed: &[u8]) -> Option<FieldDifference> {
    if recorded == replayed {
        return None;
    }
    let row = TABLE.iter().find(|row| row.member_of(topic).is_some());
    match row.and_then(|row| topics::visit(row, ShapeOf)) {
        Some(shape) => differs(&shape, "", recorded, replayed),
        None => bytes_differ("payload", recorded, replayed),
    }
}

/// The first difference of two headers in what follows from the samples that were taken: not in the times of publication, which are the
/// machine's, nor in the number of the sample.
pub fn of_headers(recorded: &SampleHeader, replayed: &SampleHeader) -> Option<FieldDifference> {
    let (recorded, replayed) = (derived(recorded), derived(replayed));
    differs(
        &SampleHeader::SHAPE,
        "header",
        bytes_of(&recorded),
        bytes_of(&replayed),
    )
}

/// What of a header does not depend on how fast the machine was.
fn derived(header: &SampleHeader) -> SampleHeader {
    let mut derived = *header;
    for (stage, busy_us) in derived.stages.iter_mut().zip(&mut derived.busy_us) {
        if stage.end == header.publish {
            stage.end = Default::default();
            *busy_us = 0;
        }
    }
    derived.publish = Default::default();
    derived.sequence >>= 32;
    derived
}

struct ShapeOf;
impl Visitor for ShapeOf {
    type Output = Shape;
    fn visit<T: Layout + fmt::Debug + 'static>(self, _: Topic<T>) -> Shape {
        T::SHAPE
    }
}

fn within(name: &str, part: impl fmt::Display) -> String {
    match name {
        "" => part.to_string(),
        name => format!("{name}.{part}"),
    }
}

fn bytes_differ(name: &str, recorded: &[u8], replayed: &[u8]) -> Option<FieldDifference> {
    let longest = recorded.len().max(replayed.len());
    let differs = |at: &usize| recorded.get(*at) != replayed.get(*at);
    let at = (0..longest).find(differs)?;
    let shown = |bytes: &[u8]| {
        bytes
            .get(at)
            .map_or("nothing".to_owned(), |byte| format!("{byte:#04x}"))
    };
    Some(FieldDifference {
        field: format!("byte {at} of {name}"),
        recorded: shown(recorded),
        replayed: shown(replayed),
    })
}

fn differs(shape: &Shape, name: &str, recorded: &[u8], replayed: &[u8]) -> Option<FieldDifference> {
    if recorded == replayed {
        return None;
    }
    match shape {
        Shape::Struct(shape) => fields_differ(shape, name, recorded, replayed),
        Shape::Array { of, len } => elements_differ(of, *len, name, recorded, replayed),
        Shape::Quantity(quantity) => numbers_differ(&quantity.components, name, recorded, replayed),
        Shape::Rotation { .. } => numbers_differ(&["w", "x", "y", "z"], name, recorded, replayed),
        Shape::Reserved(_) => None,
        Shape::Added(shape) => differs(shape, name, recorded, replayed),
        leaf => Some(FieldDifference {
            field: name.to_owned(),
            recorded: shown(leaf, recorded),
            replayed: shown(leaf, replayed),
        }),
    }
}

fn fields_differ(
    shape: &StructShape,
    name: &str,
    recorded: &[u8],
    replayed: &[u8],
) -> Option<FieldDifference> {
    let part = |bytes: &[u8], offset: usize, size: usize| -> Vec<u8> {
        let mut part = bytes.get(offset..).unwrap_or_default().to_vec();
        part.resize(size, 0);
        part
    };
    shape.fields.iter().find_map(|field| {
        let [a, b] = [recorded, replayed].map(|bytes| part(bytes, field.offset, field.size));
        let name = within(name, field.name);
        match &field.shape {
            Shape::Array { of, len } => {
                let used =
                    used(shape, field.name, *len, recorded).max(used(shape, field.name, *len, replayed));
                elements_differ(of, used, &name, &a, &b)
            }
            shape => differs(shape, &name, &a, &b),
        }
    })
}

/// How many of the `most` elements of the array called `name` count, by the field that says so.
fn used(shape: &StructShape, name: &str, most: usize, bytes: &[u8]) -> usize {
    let own = format!("{name}_len");
    let mut keys = [own.as_str(), "len", "beams"].into_iter();
    let said = keys.find_map(|key| {
        let field = shape.fields.iter().find(|field| field.name == key)?;
        let mut count = [0; 8];
        let size = field.size.min(8);
        count[..size].copy_from_slice(bytes.get(field.offset..field.offset + size)?);
        usize::try_from(u64::from_le_bytes(count)).ok()
    });
    said.unwrap_or(most).min(most)
}

fn elements_differ(
    of: &Shape,
    len: usize,
    name: &str,
    recorded: &[u8],
    replayed: &[u8],
) -> Option<FieldDifference> {
    let size = of.size().max(1);
    let pairs = recorded.chunks(size).zip(replayed.chunks(size));
    let mut pairs = pairs.take(len).enumerate();
    pairs.find_map(|(index, (a, b))| differs(of, &within(name, index), a, b))
}

fn numbers_differ(names: &[&str], name: &str, recorded: &[u8], replayed: &[u8]) -> Option<FieldDifference> {
    let number = Shape::Number(Number::F64);
    let pairs = recorded.chunks(8).zip(replayed.chunks(8));
    let mut pairs = names.iter().zip(pairs);
    pairs.find_map(|(component, (a, b))| differs(&number, &within(name, component), a, b))
}

fn shown(shape: &Shape, bytes: &[u8]) -> String {
    fn read<const N: usize>(bytes: &[u8]) -> [u8; N] {
        bytes.first_chunk().copied().unwrap_or([0; N])
    }
    match shape {
        Shape::Number(Number::F64) => format!("{:?}", f64::from_le_bytes(read(bytes))),
        Shape::Number(Number::F32) => format!("{:?}", f32::from_le_bytes(read(bytes))),
        Shape::Number(Number::U8) => u8::from_le_bytes(read(bytes)).to_string(),
        Shape::Number(Number::U16) => u16::from_le_bytes(read(bytes)).to_string(),
        Shape::Number(Number::U32) => u32::from_le_bytes(read(bytes)).to_string(),
        Shape::Number(Number::U64) => u64::from_le_bytes(read(bytes)).to_string(),
        Shape::Number(Number::I8) => i8::from_le_bytes(read(bytes)).to_string(),
        Shape::Number(Number::I16) => i16::from_le_bytes(read(bytes)).to_string(),
        Shape::Number(Number::I32) => i32::from_le_bytes(read(bytes)).to_string(),
        Shape::Number(Number::I64) => i64::from_le_bytes(read(bytes)).to_string(),
        Shape::Timestamp => match u64::from_le_bytes(read(bytes)) {
            0 => "never".to_owned(),
            ns => format!("{}.{:09} s", ns / 1_000_000_000, ns % 1_000_000_000),
        },
        Shape::Flag => (read::<1>(bytes) != [0]).to_string(),
        Shape::Enum(shape) => {
            let [code] = read(bytes);
            let known = shape.variants.iter().find(|variant| variant.code == code);
            known.map_or(format!("code {code}"), |variant| variant.text.to_owned())
        }
        _ => format!("{bytes:02x?}"),
    }
}

#[cfg(test)]
mod tests {
    use super::{of_headers, of_payloads};
    use jink_shared_types::layout::bytes_of;
    use jink_shared_types::motion::Route;
    use jink_shared_types::vehicle::VehicleState;
    use jink_shared_types::{SampleHeader, Stage, Timestamp};

    #[test]
    fn the_first_field_that_differs_is_named() {
        let recorded = VehicleState::default();
        let mut replayed = recorded;
        assert_eq!(
            of_payloads("vehicle/state", bytes_of(&recorded), bytes_of(&replayed)),
            None
        );
        replayed.position = jink_shared_types::Point::new(0.0, 0.0, -1.5);
        let difference = of_payloads("vehicle/state", bytes_of(&recorded), bytes_of(&replayed)).unwrap();
        assert_eq!(difference.field, "position.z_m");
        assert_eq!(
            (difference.recorded.as_str(), difference.replayed.as_str()),
            ("0.0", "-1.5")
        );
        let difference = of_payloads("user/echo", &[1, 2], &[1, 3]).unwrap();
        assert_eq!(difference.field, "byte 1 of payload");
    }

    #[test]
    fn what_lies_behind_the_end_of_a_list_is_not_looked_at() {
        let recorded = Route::default();
        let mut bytes = bytes_of(&recorded).to_vec();
        let last = bytes.len() - 1;
        bytes[last] ^= 1;
        assert_eq!(of_payloads("plan/route", bytes_of(&recorded), &bytes), None);
    }

    #[test]
    fn how_fast_the_machine_was_is_no_difference() {
        let begin = Timestamp::from_seconds(5.0);
        let at = |publish_s: f64| {
            let mut header = SampleHeader::at(begin).derived(Stage::Planner, begin);
            header.publish = Timestamp::from_seconds(publish_s);
            header.stages[Stage::Planner as usize].end = header.publish;
            header
        };
        assert_eq!(of_headers(&at(5.1), &at(5.2)), None);
        let mut other = at(5.1);
        other.stages[Stage::Planner as usize].begin = Timestamp::from_seconds(5.01);
        assert_eq!(
            of_headers(&at(5.1), &other).unwrap().field,
            "header.stages.2.begin"
        );
    }
}
