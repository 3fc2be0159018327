//! What a report says of a campaign: figures by cell, success by difficulty, and pictures of what failed.

use crate::page;
use serde_json::json;

/// Flights of one kind, and how many did what they could.
#[derive(Clone, Debug, PartialEq)]
pub struct Share {
    /// Which flights.
    pub name: String,
    /// How many.
    pub flights: usize,
    /// How many of them succeeded.
    pub successes: usize,
    /// In which interval the share lies (percent).
    pub interval: (f64, f64),
}

/// A flight that did not do what it should.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// A line about it.
    pub words: String,
    /// Its picture; `None` of flights of an earlier run.
    pub svg: Option<String>,
}

/// A campaign.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Campaign {
    /// The command that flew it.
    pub command: String,
    /// All of it.
    pub whole: Vec<Share>,
    /// Figures of each cell, the names of the columns first.
    pub cells: Vec<Vec<String>>,
    /// What difficulty is measured by, and the flights from the easiest to the hardest.
    pub difficulty: (String, Vec<Share>),
    /// What failed.
    pub failures: Vec<Failure>,
    /// A line about each flight.
    pub flights: Vec<String>,
}

impl Campaign {
    /// The page.
    pub fn page(&self) -> String {
        let shares = |shares: &[Share]| -> Vec<_> {
            let value = |share: &Share| json!({ "name": share.name, "flights": share.flights, "successes": share.successes, "interval": [share.interval.0, share.interval.1] });
            shares.iter().map(value).collect()
        };
        let failure = |failure: &Failure| json!({ "words": failure.words, "svg": failure.svg });
        let data = json!({
            "command": self.command,
            "whole": shares(&self.whole),
            "cells": self.cells,
            "difficulty": { "by": self.difficulty.0, "shares": shares(&self.difficulty.1) },
            "failures": self.failures.iter().map(failure).collect::<Vec<_>>(),
            "flights": self.flights,
        });
        page::campaign("jink: campaign", &data)
    }
}
