//! What jink may fly through besides what it measures, and whether its sensors suffice: as map and planner say it.

use jink_shared_types::map::declared_as;
use jink_shared_types::view::Missing;
use serde::Serialize;

/// What of it concerns a person.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct KnownSpace {
    /// Declarations of the user that are in force.
    pub declarations: Vec<&'static str>,
    /// Why no motion can be certified, and what would help; `None` if it can, or if nothing is known yet.
    pub cannot_plan: Option<String>,
    /// What would help; empty where nothing is needed.
    pub remedy: &'static str,
}

impl KnownSpace {
    /// Of the bits of [`declared_as`] in the map, and of what the planner misses.
    pub fn new(declarations: u8, unseen: Missing) -> Self {
        let names = declared_as::NAMES.iter();
        Self {
            declarations: names
                .filter(|(bit, _)| declarations & bit != 0)
                .map(|(_, name)| *name)
                .collect(),
            cannot_plan: (unseen != Missing::Nothing).then(|| format!("cannot plan: {}", unseen.text())),
            remedy: unseen.remedy(),
        }
    }

    /// What is declared, in one line.
    pub fn declared(&self) -> String {
        match self.declarations.as_slice() {
            [] => "nothing is declared: it flies through what it has seen".to_owned(),
            names => format!("declared, besides what is seen: {}", names.join(", ")),
        }
    }

    /// For people, a line or two.
    pub fn lines(&self) -> String {
        let refusal = self.cannot_plan.as_ref().map_or(String::new(), |reason| {
            format!("       NOT READY: {reason}\n       -> {}\n", self.remedy)
        });
        format!("space: {}\n{refusal}", self.declared())
    }

    /// In one sentence, why nothing flies; `None` if something does.
    pub fn refusal(&self) -> Option<String> {
        let reason = self.cannot_plan.as_ref()?;
        Some(format!("jink {reason}; {}", self.remedy))
    }
}

#[cfg(test)]
mod tests {
    use super::KnownSpace;
    use jink_shared_types::map::declared_as;
    use jink_shared_types::view::Missing;

    #[test]
    fn declarations_are_named_and_what_is_missing_comes_with_what_would_help() {
        let free = KnownSpace::new(0, Missing::Nothing);
        assert_eq!(
            free.lines(),
            "space: nothing is declared: it flies through what it has seen\n"
        );
        assert_eq!(free.refusal(), None);
        let plane = KnownSpace::new(declared_as::START | declared_as::NO_RETURN, Missing::Above);
        let text = plane.lines();
        assert!(
            text.starts_with("space: declared, besides what is seen: start bubble, no return is clear\n"),
            "{text}"
        );
        assert!(
            text.contains("NOT READY: cannot plan: nobody sees above\n")
                && text.contains("-> add a sensor that looks up"),
            "{text}"
        );
        assert!(
            plane
                .refusal()
                .unwrap()
                .contains("nobody sees above; add a sensor")
        );
    }
}
