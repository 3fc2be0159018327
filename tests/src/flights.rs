//! Promises that many flights keep: every test run flies some of them, `cargo campaigns` all, and each can be flown alone by its name.

use std::fmt;

/// The flights of one promise.
#[derive(Debug, Default)]
pub struct Flights(Vec<Flight>);

/// One flight; it panics if the promise is broken.
pub struct Flight {
    /// Unique among those of its promise: who flies, where, with which seed.
    pub name: String,
    /// Whether every test run flies it, too.
    pub in_every_run: bool,
    fly: Box<dyn Fn() + Send>,
}

impl fmt::Debug for Flight {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Flight({})", self.name)
    }
}

impl Flight {
    /// Flies it.
    ///
    /// # Panics
    /// If the promise is broken.
    pub fn fly(&self) {
        (self.fly)();
    }
}

impl Flights {
    /// None yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// One that no test run flies, only `cargo campaigns`.
    pub fn of_one(name: &str, fly: impl Fn() + Send + 'static) -> Self {
        let mut flights = Self::new();
        flights.add(name, false, fly);
        flights
    }

    /// One more, called `name` with an underscore for whatever is neither letter nor digit.
    pub fn add(&mut self, name: &str, in_every_run: bool, fly: impl Fn() + Send + 'static) {
        let word = |part: &str| part.to_lowercase();
        let parts = name.split(|character: char| !character.is_ascii_alphanumeric());
        let parts: Vec<String> = parts.filter(|part| !part.is_empty()).map(word).collect();
        self.0.push(Flight {
            name: parts.join("_"),
            in_every_run,
            fly: Box::new(fly),
        });
    }

    /// Flies those of every test run, one after the other.
    ///
    /// # Panics
    /// If the promise is broken, or if there are none.
    pub fn fly_some(&self) {
        let some: Vec<&Flight> = self.0.iter().filter(|flight| flight.in_every_run).collect();
        assert!(!some.is_empty(), "no test run flies any of {self:?}");
        for flight in some {
            println!("{}", flight.name);
            flight.fly();
        }
    }
}

impl IntoIterator for Flights {
    type Item = Flight;
    type IntoIter = std::vec::IntoIter<Flight>;
    fn into_iter(self) -> Self::IntoIter {
        self.0.into_iter()
    }
}
