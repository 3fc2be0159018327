//! The scenarios as they are written: one JSON object per line.
//!
//! Arrays of 72 are run-length coded; numbers that are none are the texts NaN, Infinity and -Infinity.

use serde_json::Value;
use std::fmt;

/// Elements of a map or of a row.
pub const BINS: usize = 72;

/// Why a line cannot be read.
#[derive(Debug)]
pub struct Unreadable(String);

impl fmt::Display for Unreadable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}
impl std::error::Error for Unreadable {}

/// One object.
#[derive(Clone, Copy, Debug)]
pub struct Node<'a> {
    value: &'a Value,
    name: &'a str,
}

impl<'a> Node<'a> {
    /// The whole line.
    pub fn root(value: &'a Value) -> Self {
        Self { value, name: "line" }
    }

    /// The member `name`, if it is there.
    pub fn find(&self, name: &'a str) -> Option<Node<'a>> {
        let value = self.value.get(name).filter(|value| !value.is_null())?;
        Some(Node { value, name })
    }

    /// The member `name`.
    pub fn get(&self, name: &'a str) -> Result<Node<'a>, Unreadable> {
        self.find(name)
            .ok_or_else(|| Unreadable(format!("{} has no {name}", self.name)))
    }

    /// A number, or the text of one that is none.
    pub fn number(&self) -> Result<f64, Unreadable> {
        match self.value {
            Value::Number(number) => number.as_f64(),
            Value::String(text) => match text.as_str() {
                "NaN" => Some(f64::NAN),
                "Infinity" => Some(f64::INFINITY),
                "-Infinity" => Some(f64::NEG_INFINITY),
                _ => None,
            },
            _ => None,
        }
        .ok_or_else(|| self.is_not("a number"))
    }

    /// A whole number.
    pub fn integer(&self) -> Result<i64, Unreadable> {
        self.value.as_i64().ok_or_else(|| self.is_not("a whole number"))
    }

    /// Yes or no.
    pub fn flag(&self) -> Result<bool, Unreadable> {
        match self.value {
            Value::Bool(flag) => Ok(*flag),
            Value::Number(number) => Ok(number.as_i64() != Some(0)),
            _ => Err(self.is_not("true or false")),
        }
    }

    /// A text.
    pub fn text(&self) -> Result<&'a str, Unreadable> {
        self.value.as_str().ok_or_else(|| self.is_not("a text"))
    }

    /// The members of a list.
    pub fn list(&self) -> Result<Vec<Node<'a>>, Unreadable> {
        let list = self.value.as_array().ok_or_else(|| self.is_not("a list"))?;
        Ok(list
            .iter()
            .map(|value| Node {
                value,
                name: self.name,
            })
            .collect())
    }

    /// A list of `N` numbers.
    pub fn numbers<const N: usize>(&self) -> Result<[f64; N], Unreadable> {
        let list: Result<Vec<f64>, _> = self.list()?.iter().map(Node::number).collect();
        list?
            .try_into()
            .map_err(|_| self.is_not(&format!("a list of {N} numbers")))
    }

    /// A run-length coded list of 72 whole numbers.
    pub fn bins(&self) -> Result<[i64; BINS], Unreadable> {
        let mut bins = Vec::with_capacity(BINS);
        for run in self.list()? {
            let run = run.list()?;
            let [value, count] = run.as_slice() else {
                return Err(self.is_not("a list of runs"));
            };
            bins.extend(std::iter::repeat_n(value.integer()?, count.integer()? as usize));
        }
        bins.try_into().map_err(|_| self.is_not("72 numbers"))
    }

    fn is_not(&self, what: &str) -> Unreadable {
        Unreadable(format!("{} is not {what}: {}", self.name, self.value))
    }
}

/// What a fragile output is.
#[derive(Clone, Debug, Default)]
pub struct Fragile {
    /// Bins of the map.
    pub bins: Vec<usize>,
    /// Setpoint and status.
    pub setpoint: bool,
}

/// The `fragile` member of a step.
pub fn fragile(step: &Node<'_>) -> Result<Fragile, Unreadable> {
    let Some(node) = step.find("fragile") else {
        return Ok(Fragile::default());
    };
    let mut fragile = Fragile::default();
    if let Some(bins) = node.find("map_bins") {
        for bin in bins.list()? {
            fragile.bins.push(bin.integer()? as usize);
        }
    }
    if let Some(setpoint) = node.find("setpoint") {
        fragile.setpoint = setpoint.flag()?;
    }
    Ok(fragile)
}
