//! What the parameters of any autopilot have in common: a table of names, and lists that are sent value by value.

use crate::link::Link;

/// Declares `Parameter`, the parameters of an autopilot: a name, a kind and a default each. The kinds are those of an enum
/// `Kind` beside it.
#[macro_export]
macro_rules! parameters {
    ($( $(#[$meta:meta])* $name:ident : $kind:ident = $default:expr; )*) => {
        /// One parameter; the variant is the autopilot's name of it.
        #[allow(non_camel_case_types)]
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Parameter { $( $(#[$meta])* $name, )* }

        impl Parameter {
            /// All of them, in the order of their MAVLink index.
            pub const ALL: &'static [Parameter] = &[$( Parameter::$name ),*];

            /// The autopilot's name.
            pub const fn name(self) -> &'static str {
                match self { $( Parameter::$name => stringify!($name), )* }
            }

            /// How it is stored.
            pub const fn kind(self) -> Kind {
                match self { $( Parameter::$name => Kind::$kind, )* }
            }

            const fn default(self) -> f64 {
                match self { $( Parameter::$name => $default, )* }
            }
        }
    };
}

/// Lists being sent: for each link the next index, if any.
#[derive(Clone, Debug, Default)]
pub struct ParameterLists {
    next: [Option<usize>; 2],
}

impl ParameterLists {
    /// Somebody on `link` asks for the list: it begins, or begins again.
    pub fn begin(&mut self, link: Link) {
        self.next[link as usize] = Some(0);
    }

    /// The index to send on `link` now, of a list of `len`; `None` if none is under way.
    pub fn take(&mut self, link: Link, len: usize) -> Option<usize> {
        let slot = &mut self.next[link as usize];
        let index = slot.take()?;
        *slot = (index + 1 < len).then_some(index + 1);
        Some(index)
    }
}
