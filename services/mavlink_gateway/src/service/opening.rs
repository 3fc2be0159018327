//! Opening the links of the configuration.

use super::needs;
use crate::{ProfileChoice, Representation};
use jink_mavlink_link::link::{Link, LinkError};
use jink_mavlink_link::links::{LinkSetup, Links, SetupCause};
use jink_mavlink_link::tlog::Tlog;
use jink_runtime::{Ports, StartError, config};
use std::path::PathBuf;
use std::time::Duration;

/// What is wrong with the links of a configuration: the table, its key, and the sentence.
pub fn check_links(settings: &config::Link) -> Vec<(String, String, String)> {
    let rows = settings.rows();
    let of_links = rows
        .iter()
        .filter_map(|row| LinkSetup::of(row).err().map(|error| (row, error)));
    let mut mistakes: Vec<_> = of_links
        .map(|(row, error)| {
            let key = error.key.strip_prefix(&row.table).unwrap_or_default();
            let key = key.trim_start_matches('.').split(' ').next().unwrap_or_default();
            // The address names itself.
            let sentence = match (&error.cause, row.table.as_str()) {
                (SetupCause::Address(cause), "link") => cause.to_string(),
                _ => error.to_string(),
            };
            (row.table.clone(), key.to_owned(), sentence)
        })
        .collect();
    let mut word = |key: &str, refused: Option<String>| {
        mistakes.extend(refused.map(|cause| ("link".to_owned(), key.to_owned(), cause)));
    };
    let profile = settings.profile.parse::<ProfileChoice>();
    word("profile", profile.err().map(|error| error.to_string()));
    let output = settings.output.parse::<Representation>();
    word("output", output.err().map(|error| error.to_string()));
    mistakes
}

/// How long a restarted gateway waits for its port to be let go (s).
const RELEASE_S: f64 = 0.3;

/// Opens or joins all links of the configuration.
pub(super) fn open_links(ports: &Ports) -> Result<Links, StartError> {
    let (settings, setup) = (&ports.config().link, ports.setup());
    let mut setups = Vec::new();
    for row in settings.rows() {
        let link = LinkSetup::of(&row).map_err(|error| needs(error.key)(error.cause))?;
        if link.is_exposed() {
            tracing::warn!(
                "{}: anybody on the network can speak on {}; name the peers, or set signing = \"require\"",
                row.table,
                row.address
            );
        }
        setups.push(link);
    }
    let doors: Vec<_> = (0..setups.len())
        .map(|index| match index {
            0 => setup.instance.handover_socket(&setup.process),
            _ => setup
                .instance
                .handover_socket(&format!("{}.{index}", setup.process)),
        })
        .collect();
    let opened = if setup.shadow {
        Links::join(setups, &doors)
    } else {
        Links::open(setups, &doors, |first| open(first, setup.generation))
    };
    let mut links = opened.map_err(needs("link.address".to_owned()))?;
    let state = (!settings.state.is_empty()).then(|| PathBuf::from(&settings.state));
    let kept = state.clone().unwrap_or_else(|| setup.instance.folder());
    let stamps = kept.join(format!("{}.stamps", setup.process));
    links
        .sign_with_stamps_at(&stamps)
        .map_err(needs(format!("link.state: {}", stamps.display())))?;
    let senders = setup.instance.signed_senders();
    let copy = state.map(|state| state.join(format!("{}.senders", setup.process)));
    links
        .remember_senders_at(&senders, copy.as_deref())
        .map_err(needs(senders.display().to_string()))?;
    if !settings.tlog.is_empty() {
        let max_bytes = u64::from(settings.tlog_max_mb) * 1_000_000;
        links.record(Tlog::begin(&setup.instance.spool(), setup.generation, max_bytes));
    }
    Ok(links)
}

/// Opens the first link. At a restart a second instance that is just being ended may still have it for a moment.
fn open(setup: &LinkSetup, generation: u32) -> Result<Link, LinkError> {
    let patience = jink_runtime::now().plus_seconds(RELEASE_S);
    loop {
        match Link::open(setup.endpoint.clone()) {
            Err(LinkError::AddressInUse { .. }) if generation > 1 && jink_runtime::now() < patience => {
                std::thread::sleep(Duration::from_millis(2));
            }
            opened => return opened,
        }
    }
}
