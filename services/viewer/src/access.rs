//! Who may read the page, and who may change a parameter.
//!
//! | request | needs |
//! |---|---|
//! | any | a `Host` that is the address it came in on, or `localhost` on this host: a name that somebody else's DNS leads here is refused |
//! | any with `Origin` | that of the page itself: pages of others can neither read nor ask |
//! | reading, where other hosts can reach the address | the token, as `Authorization: Bearer` or as the cookie that the page sets |
//! | changing a parameter | the token as `Authorization: Bearer`, which a browser never sends by itself |

use crate::http::Request;
use std::fs::File;
use std::io::{Read, Write};
use std::net::SocketAddr;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::Path;

/// Lengths of tokens (characters): at least as hard to guess as 16 letters.
const TOKEN_CHARS: std::ops::RangeInclusive<usize> = 16..=128;
/// Random bytes in a token of our own.
const TOKEN_BYTES: usize = 16;
/// The cookie in which the page keeps the token for what a browser fetches by itself.
const COOKIE: &str = "jink_token";
/// Bits of a file's mode that let other users read or write it.
const OTHERS: u32 = 0o077;

/// See the module.
#[derive(Clone, Debug)]
pub struct Access {
    token: String,
    /// Readers need the token, too.
    is_closed: bool,
}

/// Why a request is refused: status, and a sentence.
pub type Refused = (&'static str, &'static str);

const WRONG_HOST: Refused = (
    "403 Forbidden",
    "jink: open this page under the address that it is served at, as `jink status` shows it\n",
);
const WRONG_ORIGIN: Refused = ("403 Forbidden", "jink: a page of somebody else asks\n");
const NO_TOKEN: Refused = (
    "401 Unauthorized",
    "jink: the token is missing or wrong (docs/viewer.md)\n",
);

impl Access {
    /// With this token; where `is_closed`, readers need it, too.
    pub fn new(token: &str, is_closed: bool) -> Self {
        Self {
            token: token.to_owned(),
            is_closed,
        }
    }

    /// Whether a request that came in on the address `local` is one of the page itself.
    ///
    /// # Errors
    /// Status and sentence of the refusal.
    pub fn check_source(&self, request: &Request, local: SocketAddr) -> Result<(), Refused> {
        let host = request.header("host").ok_or(WRONG_HOST)?;
        if !is_own(host, local) {
            return Err(WRONG_HOST);
        }
        if !request.has("origin") {
            return Ok(());
        }
        let origin = request
            .header("origin")
            .and_then(|origin| origin.strip_prefix("http://"));
        // The same host and not only one of ours: a page that was opened under another of our names is another page.
        match origin.is_some_and(|origin| origin.eq_ignore_ascii_case(host)) {
            true => Ok(()),
            false => Err(WRONG_ORIGIN),
        }
    }

    /// Whether it may read.
    ///
    /// # Errors
    /// Status and sentence of the refusal.
    pub fn check_reading(&self, request: &Request) -> Result<(), Refused> {
        let cookie = request.header("cookie").unwrap_or_default();
        let mut cookies = cookie
            .split(';')
            .filter_map(|cookie| cookie.trim().split_once('='));
        let mut is_in_cookie = || cookies.any(|(name, value)| name == COOKIE && self.is_token(value));
        match !self.is_closed || self.has_bearer(request) || is_in_cookie() {
            true => Ok(()),
            false => Err(NO_TOKEN),
        }
    }

    /// Whether it may change a parameter.
    ///
    /// # Errors
    /// Status and sentence of the refusal.
    pub fn check_changing(&self, request: &Request) -> Result<(), Refused> {
        match self.has_bearer(request) {
            true => Ok(()),
            false => Err(NO_TOKEN),
        }
    }

    fn has_bearer(&self, request: &Request) -> bool {
        let given = request
            .header("authorization")
            .and_then(|word| word.strip_prefix("Bearer "));
        given.is_some_and(|given| self.is_token(given))
    }

    /// Takes as long wherever the first difference is.
    fn is_token(&self, given: &str) -> bool {
        let (own, given) = (self.token.as_bytes(), given.as_bytes());
        let differences = own
            .iter()
            .zip(given)
            .fold(0, |all, (own, given)| all | (own ^ given));
        own.len() == given.len() && differences == 0
    }
}

/// Whether `host` is the address `local` that the request came in on, with its port where it is not that of HTTP.
fn is_own(host: &str, local: SocketAddr) -> bool {
    let host = match host.strip_prefix("localhost") {
        Some(rest) if local.ip().is_loopback() => format!("{}{rest}", bracketed(local)),
        _ => host.to_owned(),
    };
    match host.parse::<SocketAddr>() {
        Ok(named) => named.ip() == local.ip() && named.port() == local.port(),
        Err(_) => local.port() == 80 && host == bracketed(local),
    }
}

fn bracketed(address: SocketAddr) -> String {
    match address {
        SocketAddr::V4(address) => address.ip().to_string(),
        SocketAddr::V6(address) => format!("[{}]", address.ip()),
    }
}

/// The token in `file`, which nobody else may read.
///
/// # Errors
/// A sentence.
pub fn read_token(file: &Path) -> Result<String, String> {
    let failed = |cause: &dyn std::fmt::Display| format!("token_file {}: {cause}", file.display());
    let mut opened = File::open(file).map_err(|error| failed(&error))?;
    let found = opened.metadata().map_err(|error| failed(&error))?;
    if !found.is_file() {
        return Err(failed(&"is no file"));
    }
    if found.mode() & OTHERS != 0 {
        return Err(failed(&"others may read it: chmod 600"));
    }
    let mut text = String::new();
    let mut limited = (&mut opened).take(1 + *TOKEN_CHARS.end() as u64 * 2);
    limited
        .read_to_string(&mut text)
        .map_err(|error| failed(&error))?;
    let token = text.trim();
    let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    match TOKEN_CHARS.contains(&token.len()) && token.chars().all(is_plain) {
        true => Ok(token.to_owned()),
        false => {
            let words = format!(
                "must hold {} to {} letters, digits, - and _ in one line",
                TOKEN_CHARS.start(),
                TOKEN_CHARS.end()
            );
            Err(failed(&words))
        }
    }
}

/// The token that an earlier start of this instance's viewer has left in `file`, or a new one.
///
/// # Errors
/// A sentence.
pub fn own_token(file: &Path) -> Result<String, String> {
    if let Ok(token) = read_token(file) {
        return Ok(token);
    }
    let failed = |error: std::io::Error| format!("{}: {error}", file.display());
    let mut random = [0; TOKEN_BYTES];
    File::open("/dev/urandom")
        .and_then(|mut source| source.read_exact(&mut random))
        .map_err(failed)?;
    let token: String = random.iter().map(|byte| format!("{byte:02x}")).collect();
    // What stands there cannot be trusted, and its mode would stay.
    let _was_none = std::fs::remove_file(file);
    let mut written = File::options()
        .create_new(true)
        .write(true)
        .mode(0o600)
        .open(file)
        .map_err(failed)?;
    writeln!(written, "{token}").map_err(failed)?;
    Ok(token)
}

#[cfg(test)]
mod tests {
    use super::{is_own, own_token, read_token};
    use std::os::unix::fs::PermissionsExt;

    #[test]
    fn only_the_address_itself_and_localhost_are_names_of_this_page() {
        for (local, host, is) in [
            ("127.0.0.1:8080", "127.0.0.1:8080", true),
            ("127.0.0.1:8080", "localhost:8080", true),
            ("127.0.0.1:8080", "localhost:8081", false),
            ("127.0.0.1:8080", "localhost", false),
            ("127.0.0.1:80", "localhost", true),
            ("127.0.0.1:80", "127.0.0.1", true),
            ("127.0.0.1:8080", "127.0.0.1.evil.example:8080", false),
            ("127.0.0.1:8080", "localhost.evil.example:8080", false),
            ("127.0.0.1:8080", "evil.example:8080", false),
            ("127.0.0.1:8080", "", false),
            ("[::1]:8080", "[::1]:8080", true),
            ("[::1]:8080", "localhost:8080", true),
            ("10.0.0.7:8080", "10.0.0.7:8080", true),
            ("10.0.0.7:8080", "localhost:8080", false),
            ("10.0.0.7:8080", "10.0.0.8:8080", false),
        ] {
            assert_eq!(is_own(host, local.parse().unwrap()), is, "{host} on {local}");
        }
    }

    #[test]
    fn a_token_is_made_once_for_its_user_alone_and_one_that_others_may_read_is_refused() {
        let file = std::env::temp_dir().join(format!("jink_viewer_token_{}", std::process::id()));
        let token = own_token(&file).unwrap();
        assert_eq!(token.len(), 32);
        assert_eq!(own_token(&file).unwrap(), token, "another start has the same");
        let mode = std::fs::metadata(&file).unwrap().permissions().mode() & 0o777;
        assert_eq!(mode, 0o600);
        std::fs::set_permissions(&file, PermissionsExt::from_mode(0o644)).unwrap();
        assert!(read_token(&file).unwrap_err().contains("chmod 600"));
        assert_ne!(own_token(&file).unwrap(), token);
        std::fs::write(&file, "short\n").unwrap();
        assert!(read_token(&file).unwrap_err().contains("16 to 128"));
        std::fs::remove_file(&file).unwrap();
    }
}
