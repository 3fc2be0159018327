//! Reading any topic by its name: the headers of what comes, in the order in which it was published.

use crate::Problem;
use jink_runtime::{Checks, Session};
use jink_shared_types::SampleHeader;
use jink_shared_types::layout::Layout;
use jink_shared_types::topics::{self, Topic, TopicRow, Visitor};
use std::fmt::Debug;

/// Appends the headers of everything unread.
type Take = Box<dyn FnMut(&mut Vec<SampleHeader>)>;

/// A topic that is listened to; payloads are not looked at.
pub struct Meter {
    /// Its name.
    pub name: String,
    /// Its row, of the table or of the configuration.
    pub row: TopicRow,
    take: Take,
    headers: Vec<SampleHeader>,
}

impl std::fmt::Debug for Meter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Meter({})", self.name)
    }
}

impl Meter {
    /// Listens to member `member` of `row` from now on.
    pub fn open(session: &Session, row: &TopicRow, member: &str) -> Result<Self, Problem> {
        let name = row.topic_name(member);
        let take = topics::visit(row, Open { session, member })
            .ok_or_else(|| Problem::Other(format!("{name} is not in the topic table")))??;
        Ok(Self {
            name,
            row: *row,
            take,
            headers: Vec::new(),
        })
    }

    /// Listens to a topic that the configuration declares; `None` as long as nobody else uses it.
    pub fn open_declared(session: &Session, row: &TopicRow) -> Result<Option<Self>, Problem> {
        let Some(mut input) = session.raw_input(row, row.name)? else {
            return Ok(None);
        };
        Ok(Some(Self {
            name: row.name.to_owned(),
            row: *row,
            take: Box::new(move |headers| input.each(|header, _| headers.push(*header))),
            headers: Vec::new(),
        }))
    }

    /// Hands the header of every sample that has come to `visit`. Of several producers each has a queue of its own, so
    /// that they are put in order here.
    pub fn look(&mut self, mut visit: impl FnMut(&SampleHeader)) {
        (self.take)(&mut self.headers);
        self.headers.sort_by_key(|header| header.publish);
        self.headers.drain(..).for_each(|header| visit(&header));
    }
}

struct Open<'a> {
    session: &'a Session,
    member: &'a str,
}

impl Visitor for Open<'_> {
    type Output = Result<Take, Problem>;

    fn visit<T: Layout + Debug + 'static>(self, topic: Topic<T>) -> Self::Output {
        let input = self.session.input(topic, self.member)?;
        let mut input = input.of_all_producers().with_checks(Checks::None);
        Ok(Box::new(move |headers| {
            input.each(|stamped| headers.push(*stamped.header));
        }))
    }
}
