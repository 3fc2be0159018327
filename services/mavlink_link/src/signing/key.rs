//! The secret key and the file it stands in.

use rustix::fs::{Mode, OFlags};
use sha2::{Digest, Sha256};
use std::fmt;
use std::fs::File;
use std::io::{self, Read};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Bytes of a key.
const KEY_BYTES: usize = 32;
/// Begins a line that is hashed to the key, as ground stations do with what the user types.
const PASSPHRASE: &[u8] = b"passphrase:";
/// Bytes read of a key file at most: no passphrase is longer.
const FILE_MAX: u64 = 1024;

/// A secret key. It is never printed.
#[derive(Clone, PartialEq, Eq)]
pub struct Key([u8; KEY_BYTES]);

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Key(secret)")
    }
}

/// Why there is no key.
#[derive(Debug)]
pub enum KeyError {
    /// The file cannot be read.
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// Others may read or change it.
    TooOpen {
        /// The file.
        path: PathBuf,
        /// Its permissions.
        mode: u32,
    },
    /// It belongs to another user.
    NotOurs {
        /// The file.
        path: PathBuf,
        /// Whose it is (user id).
        owner: u32,
        /// Who we are (user id).
        user: u32,
    },
    /// It holds no key.
    NoKey {
        /// The file.
        path: PathBuf,
    },
}

impl fmt::Display for KeyError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            KeyError::Read { path, source } => write!(f, "{}: cannot be read: {source}", path.display()),
            KeyError::TooOpen { path, mode } => write!(
                f,
                "{path}: others may read or change it (mode {mode:04o}); `chmod 600 {path}`",
                path = path.display()
            ),
            KeyError::NotOurs { path, owner, user } => write!(
                f,
                "{path}: belongs to user {owner}, and this is user {user}; `chown {user} {path}`",
                path = path.display()
            ),
            KeyError::NoKey { path } => write!(
                f,
                "{}: no key; it holds 32 bytes, 64 hexadecimal digits, or one line passphrase:WORDS",
                path.display()
            ),
        }
    }
}

impl std::error::Error for KeyError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            KeyError::Read { source, .. } => Some(source),
            KeyError::TooOpen { .. } | KeyError::NotOurs { .. } | KeyError::NoKey { .. } => None,
        }
    }
}

impl Key {
    /// The key in a file that only its owner, this user, may read.
    ///
    /// # Errors
    /// [`KeyError`] with what to do about it.
    pub fn read(path: &Path) -> Result<Self, KeyError> {
        let read = |source: io::Error| KeyError::Read {
            path: path.to_owned(),
            source,
        };
        // Something that is no file, such as a pipe, must not block the start.
        let flags = OFlags::RDONLY | OFlags::CLOEXEC | OFlags::NONBLOCK;
        let fd = rustix::fs::open(path, flags, Mode::empty()).map_err(|error| read(error.into()))?;
        let file = File::from(fd);
        // Asked of the open file: what is at the path may change meanwhile.
        let metadata = file.metadata().map_err(read)?;
        let (mode, owner) = (metadata.mode() & 0o7777, metadata.uid());
        if mode & 0o177 != 0 {
            return Err(KeyError::TooOpen {
                path: path.to_owned(),
                mode,
            });
        }
        let user = rustix::process::geteuid().as_raw();
        if owner != user {
            return Err(KeyError::NotOurs {
                path: path.to_owned(),
                owner,
                user,
            });
        }
        let mut content = Vec::new();
        file.take(FILE_MAX).read_to_end(&mut content).map_err(read)?;
        Self::of_bytes(&content).ok_or(KeyError::NoKey {
            path: path.to_owned(),
        })
    }

    /// The key that the content of a key file stands for.
    pub fn of_bytes(content: &[u8]) -> Option<Self> {
        // Editors of Windows begin a text with a byte order mark.
        let text = content.strip_prefix("\u{feff}".as_bytes()).unwrap_or(content);
        if let Some(rest) = text.strip_prefix(PASSPHRASE) {
            let line = rest.strip_suffix(b"\n").unwrap_or(rest);
            let line = line.strip_suffix(b"\r").unwrap_or(line);
            let is_one_line = !line.is_empty() && !line.contains(&b'\n');
            return is_one_line.then(|| Self(Sha256::digest(line).into()));
        }
        if let Ok(raw) = content.try_into() {
            return Some(Self(raw));
        }
        let digits = text.trim_ascii();
        let mut key = [0; KEY_BYTES];
        if digits.len() != 2 * KEY_BYTES {
            return None;
        }
        for (pair, byte) in digits.chunks_exact(2).zip(&mut key) {
            let digit = |digit: u8| char::from(digit).to_digit(16);
            *byte = (16 * digit(pair[0])? + digit(pair[1])?) as u8;
        }
        Some(Self(key))
    }

    pub(super) fn bytes(&self) -> &[u8; KEY_BYTES] {
        &self.0
    }
}

#[cfg(test)]
mod tests {
    use super::{Key, KeyError};
    use std::os::unix::fs::PermissionsExt;
    use std::path::PathBuf;

    #[test]
    fn a_key_is_bytes_digits_or_words() {
        let raw: [u8; 32] = std::array::from_fn(|i| i as u8 + 200);
        let digits: String = raw.iter().map(|byte| format!("{byte:02X}")).collect();
        let of_raw = Key::of_bytes(&raw).unwrap();
        assert_eq!(Key::of_bytes(format!("{digits}\n").as_bytes()).unwrap(), of_raw);
        assert_eq!(
            Key::of_bytes(format!("\u{feff}{digits}\r\n").as_bytes()).unwrap(),
            of_raw
        );
        assert_eq!(
            Key::of_bytes("\u{feff}passphrase:two words\r\n".as_bytes()),
            Key::of_bytes(b"passphrase:two words\n")
        );
        // SHA-256 of "abc": FIPS 180-2, appendix B.1.
        let abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        for line in ["passphrase:abc", "passphrase:abc\n", "passphrase:abc\r\n"] {
            assert_eq!(
                Key::of_bytes(line.as_bytes()),
                Key::of_bytes(abc.as_bytes()),
                "{line:?}"
            );
        }
        for none in [
            "",
            "passphrase:",
            "passphrase:a\nb",
            "secret",
            &digits[1..],
            &abc.replace('a', "g"),
        ] {
            assert_eq!(Key::of_bytes(none.as_bytes()), None, "{none:?}");
        }
    }

    #[test]
    fn a_key_is_never_printed() {
        let key = Key::of_bytes(&[0xab; 32]).unwrap();
        assert_eq!(format!("{key:?}"), "Key(secret)");
    }

    #[test]
    fn a_file_that_others_may_read_is_no_secret() {
        let path: PathBuf = std::env::temp_dir().join(format!("jink_key_{}", std::process::id()));
        std::fs::write(&path, [7; 32]).unwrap();
        let set_mode = |mode| {
            std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
        };
        for mode in [0o644, 0o640, 0o602, 0o700] {
            set_mode(mode);
            let error = Key::read(&path).unwrap_err();
            assert!(matches!(error, KeyError::TooOpen { .. }), "{mode:o}: {error}");
            assert!(
                error
                    .to_string()
                    .contains(&format!("chmod 600 {}", path.display()))
            );
        }
        for mode in [0o600, 0o400] {
            set_mode(mode);
            assert_eq!(Key::read(&path).unwrap(), Key::of_bytes(&[7; 32]).unwrap());
        }
        set_mode(0o600);
        std::fs::write(&path, "short").unwrap();
        assert!(matches!(Key::read(&path).unwrap_err(), KeyError::NoKey { .. }));
        std::fs::remove_file(&path).unwrap();
        assert!(matches!(Key::read(&path).unwrap_err(), KeyError::Read { .. }));
    }
}
