//! The topics and samples of this build, for programs in other languages and for recordings: what the topic table and `sample!` say.

pub use crate::schema_json::json;

use jink_shared_types::SampleHeader;
use jink_shared_types::layout::{Layout, type_name};
use jink_shared_types::shape::{EnumShape, QuantityShape, Shape, StructShape};
use jink_shared_types::suggestion::{DidYouMean, nearest};
use jink_shared_types::topics::{self, TABLE, Topic, TopicRow, Visitor};
use std::fmt;

/// A sample that has a type name of its own for iceoryx2.
#[derive(Clone, Copy, Debug)]
pub struct Payload {
    /// What it looks like.
    pub shape: &'static StructShape,
    /// Its name with the layout hash.
    pub type_name: &'static str,
}

impl Payload {
    /// Of `T`; `None` if that is no sample but a number.
    fn of<T: Layout>() -> Option<Self> {
        let type_name = type_name::<T>();
        match T::SHAPE {
            Shape::Struct(shape) => Some(Self { shape, type_name }),
            _ => None,
        }
    }
}

/// A topic with its payload.
#[derive(Clone, Copy, Debug)]
pub struct TopicEntry {
    /// Its row.
    pub row: &'static TopicRow,
    /// What its samples are.
    pub payload: Payload,
}

/// Topics, and everything their samples are made of. What holds another comes after it.
#[derive(Clone, Debug, Default)]
pub struct Schema {
    /// Topics in the order of the table.
    pub topics: Vec<TopicEntry>,
    /// The user header of every topic, then the payloads, each once.
    pub payloads: Vec<Payload>,
    /// Samples and their parts.
    pub structs: Vec<&'static StructShape>,
    /// Enums in them.
    pub enums: Vec<&'static EnumShape>,
    /// Vectors in them.
    pub quantities: Vec<QuantityShape>,
    /// Rotations in them: frames from and to.
    pub rotations: Vec<(&'static str, &'static str)>,
}

/// No topic has such a payload.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownType {
    /// What was asked for.
    pub name: String,
    /// What was perhaps meant.
    pub nearest: Option<&'static str>,
}

impl fmt::Display for UnknownType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, nearest } = self;
        write!(
            f,
            "no topic has the payload {name}{}; `jink schema` shows all",
            DidYouMean(*nearest)
        )
    }
}
impl std::error::Error for UnknownType {}

struct PayloadOf;
impl Visitor for PayloadOf {
    type Output = Option<Payload>;
    fn visit<T: Layout + fmt::Debug + 'static>(self, _: Topic<T>) -> Option<Payload> {
        Payload::of::<T>()
    }
}

impl Schema {
    /// Of the topics whose payloads are named in `types`, of every topic if it is empty. The user header is always in
    /// it.
    ///
    /// # Errors
    /// [`UnknownType`] for a name that no payload has.
    pub fn of(types: &[String]) -> Result<Self, UnknownType> {
        for name in types {
            if !TABLE.iter().any(|row| row.payload == name) {
                return Err(UnknownType {
                    name: name.clone(),
                    nearest: nearest(name, TABLE.iter().map(|row| row.payload)),
                });
            }
        }
        let mut schema = Self::default();
        schema.add_payload(Payload::of::<SampleHeader>());
        let asked_for = |row: &&TopicRow| types.is_empty() || types.iter().any(|name| name == row.payload);
        for row in TABLE.iter().filter(asked_for) {
            let payload = topics::visit(row, PayloadOf).flatten();
            schema
                .topics
                .extend(payload.map(|payload| TopicEntry { row, payload }));
            schema.add_payload(payload);
        }
        Ok(schema)
    }

    fn add_payload(&mut self, payload: Option<Payload>) {
        if let Some(payload) = payload
            && !self
                .payloads
                .iter()
                .any(|known| known.type_name == payload.type_name)
        {
            self.add_struct(payload.shape);
            self.payloads.push(payload);
        }
    }

    fn add_struct(&mut self, shape: &'static StructShape) {
        if self.structs.iter().any(|known| known.name == shape.name) {
            return;
        }
        for field in shape.fields {
            self.add(&field.shape);
        }
        self.structs.push(shape);
    }

    fn add(&mut self, shape: &Shape) {
        match *shape {
            Shape::Number(_) | Shape::Flag | Shape::Timestamp | Shape::Reserved(_) => {}
            Shape::Enum(shape) => {
                if !self.enums.iter().any(|known| known.name == shape.name) {
                    self.enums.push(shape);
                }
            }
            Shape::Quantity(shape) => {
                if !self.quantities.contains(&shape) {
                    self.quantities.push(shape);
                }
            }
            Shape::Rotation { from, to } => {
                if !self.rotations.contains(&(from, to)) {
                    self.rotations.push((from, to));
                }
            }
            Shape::Array { of: shape, .. } | Shape::Added(shape) => self.add(shape),
            Shape::Struct(shape) => self.add_struct(shape),
        }
    }

    /// The type name of a sample, if it is a payload or the user header.
    pub fn type_name(&self, shape: &StructShape) -> Option<&'static str> {
        let payload = self
            .payloads
            .iter()
            .find(|payload| payload.shape.name == shape.name);
        payload.map(|payload| payload.type_name)
    }
}

/// The lines of a comment: documentation without the indentation and the links that it has in the source.
pub fn comment(docs: &[&str]) -> impl Iterator<Item = String> {
    docs.iter().map(|line| without_links(line.trim()))
}

/// ``[`A`](b)`` and ``[`A`]`` as `` `A` ``.
fn without_links(line: &str) -> String {
    let mut out = String::new();
    let mut rest = line;
    while let Some((before, link)) = rest.split_once("[`") {
        let Some((name, behind)) = link.split_once("`]") else {
            break;
        };
        out.push_str(&format!("{before}`{name}`"));
        let target = behind.strip_prefix('(').and_then(|target| target.split_once(')'));
        rest = target.map_or(behind, |(_, behind)| behind);
    }
    out + rest
}

#[cfg(test)]
mod tests {
    use super::{Schema, without_links};
    use jink_shared_types::topics::TABLE;

    #[test]
    fn links_of_the_source_are_names_elsewhere() {
        assert_eq!(without_links("No link."), "No link.");
        assert_eq!(
            without_links("See [`A`], [`B`](crate::B) and [c]."),
            "See `A`, `B` and [c]."
        );
        assert_eq!(without_links("An open [`A"), "An open [`A");
    }

    #[test]
    fn every_topic_is_in_it_and_parts_come_before_what_holds_them() {
        let all = Schema::of(&[]).unwrap();
        assert_eq!(all.topics.len(), TABLE.len());
        let place = |name: &str| all.structs.iter().position(|shape| shape.name == name).unwrap();
        assert!(place("StageTime") < place("SampleHeader"));
        assert!(place("Heartbeat") < place("ProcessStatus"));
        assert!(place("ProcessStatus") < place("SystemStatus"));
    }

    #[test]
    fn one_type_brings_its_parts_and_the_header_and_nothing_else() {
        let one = Schema::of(&["Route".to_owned()]).unwrap();
        let names: Vec<&str> = one.structs.iter().map(|shape| shape.name).collect();
        assert_eq!(names.last(), Some(&"Route"));
        assert!(names.contains(&"SampleHeader") && names.contains(&"Polytope"));
        assert!(!names.contains(&"VehicleState"));
        assert_eq!(one.topics.len(), 1);
    }

    #[test]
    fn a_type_that_is_not_is_reported_with_the_nearest() {
        let unknown = Schema::of(&["VehicleStat".to_owned()]).unwrap_err();
        assert_eq!(unknown.nearest, Some("VehicleState"));
    }
}
