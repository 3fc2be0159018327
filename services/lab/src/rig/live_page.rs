//! The live page of a flight: its address is shown, and opened where there is a desktop.

use super::show::Show;
use jink_runtime::Instance;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Command, Stdio};

/// What becomes of the address of the live page.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ShownPage {
    /// Nothing.
    #[default]
    Ignored,
    /// It is shown.
    Named,
    /// It is shown, and opened in a browser.
    Opened,
}

/// A page that has not been shown yet.
#[derive(Debug)]
pub struct LivePage {
    /// The file in which the viewer says where it is.
    address: PathBuf,
    opens: bool,
}

impl LivePage {
    /// The live page of `instance`; `None` where its address is not to be shown.
    pub fn of(instance: &Instance, shown: ShownPage) -> Option<Self> {
        (shown != ShownPage::Ignored).then(|| Self {
            address: instance.viewer_address(),
            opens: shown == ShownPage::Opened,
        })
    }

    /// Shows it, if it is served; else it is to be looked for again.
    pub fn look(self, show: &mut Show) -> Option<Self> {
        let Ok(address) = std::fs::read_to_string(&self.address) else {
            return Some(self);
        };
        let address = address.trim();
        show.update(&format!("watch: {address}"));
        if self.opens && has_desktop() {
            open(address);
        }
        None
    }
}

/// Whether a browser could be seen.
fn has_desktop() -> bool {
    let is_set = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    is_set("DISPLAY") || is_set("WAYLAND_DISPLAY")
}

/// Has the desktop open it, in a process group of its own, so that Ctrl-C reaches this command alone. Nobody waits for it.
fn open(address: &str) {
    let _absent = Command::new("xdg-open")
        .arg(address)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .process_group(0)
        .spawn();
}
