//! `docs/texts.md` has every text that a pilot may read, as the event table has it.
#![allow(clippy::unwrap_used)]

use jink_shared_types::coded::Wire;
use jink_shared_types::events::{Event, TABLE, Told};
use std::path::Path;

/// Where the tables of the page begin.
const TABLES: &str = "## The texts\n";

/// A text as a person reads it on the page.
fn shown(event: &Event) -> String {
    let blanks = [
        ("{name}", "NAME"),
        ("{why}", "WHY"),
        ("{reason}", "WHY"),
        ("{n}", "N"),
        ("{0}", "X"),
        ("{1}", "Y"),
    ];
    blanks.iter().fold(event.text.to_owned(), |text, (blank, word)| {
        text.replace(blank, word)
    })
}

fn when(event: &Event) -> &'static str {
    match event.told {
        Told::Logged => "",
        Told::News => "when it happens",
        Told::Answer => "each time",
        Told::Until(_) => "while it lasts",
        Told::End => "once",
    }
}

fn tables() -> String {
    let mut page = format!("{TABLES}\n| text | severity | said | because | to do |\n|---|---|---|---|---|\n");
    for event in TABLE.iter().filter(|event| event.told != Told::Logged) {
        page += &format!(
            "| {} | {} | {} | {} | {} |\n",
            shown(event),
            event.severity.name(),
            when(event),
            event.cause(),
            event.action
        );
    }
    page += "\n## What is only logged\n\n| in the log | because | to do |\n|---|---|---|\n";
    for event in TABLE.iter().filter(|event| event.told == Told::Logged) {
        page += &format!("| {} | {} | {} |\n", shown(event), event.cause(), event.action);
    }
    page
}

#[test]
fn the_page_says_of_every_text_why_it_is_said_and_what_to_do() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/texts.md");
    let page = std::fs::read_to_string(&file).unwrap();
    let begin = page.find(TABLES).unwrap_or(page.len());
    let expected = format!("{}{}", &page[..begin], tables());
    if page != expected {
        let made = Path::new(env!("CARGO_TARGET_TMPDIR")).join("texts.md");
        std::fs::write(&made, expected).unwrap();
        panic!(
            "docs/texts.md is not what the event table says; {} is",
            made.display()
        );
    }
}

#[test]
fn every_row_has_a_cause_and_an_action() {
    for event in TABLE {
        assert!(
            event.cause().ends_with('.') && event.action.ends_with('.'),
            "{}",
            event.text
        );
        assert!(event.cause().len() > 10, "{}", event.text);
    }
}
