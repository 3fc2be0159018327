//! Where the live page is served, and who may read it.

use serde::Deserialize;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// Where the live page is served, and who may read it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Viewer {
    /// Address and port; port 0 = any free one. `None` = nothing is served.
    pub address: Option<SocketAddr>,
    /// The file with the token: readers on other hosts need it, and changes of parameters.
    pub token_file: Option<PathBuf>,
}

/// [`Viewer`] as jink.toml has it.
#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
pub(super) struct ViewerTable {
    address: Option<Spanned<String>>,
    token_file: Option<Spanned<String>>,
}

impl ViewerTable {
    /// What it says.
    ///
    /// # Errors
    /// The first mistake, an address that is none or a path that is not absolute: where it stands, and a sentence about it.
    pub(super) fn read(&self) -> Result<Viewer, (usize, String)> {
        let given = |word: &Option<Spanned<String>>| {
            let word = word.as_ref().filter(|word| !word.get_ref().is_empty())?;
            Some((word.get_ref().clone(), word.span().start))
        };
        let address = given(&self.address).map(|(address, place)| {
            let parsed = match address.strip_prefix("localhost:") {
                Some(port) => format!("127.0.0.1:{port}").parse(),
                None => address.parse(),
            };
            let message =
                || format!("address of [viewer] is ADDRESS:PORT, e.g. \"127.0.0.1:8080\", not {address:?}");
            parsed.map_err(|_| (place, message()))
        });
        let token_file = given(&self.token_file).map(|(file, place)| match Path::new(&file).is_absolute() {
            true => Ok(PathBuf::from(file)),
            false => Err((
                place,
                format!("token_file of [viewer] is an absolute path, not {file:?}"),
            )),
        });
        Ok(Viewer {
            address: address.transpose()?,
            token_file: token_file.transpose()?,
        })
    }
}

impl Viewer {
    /// Why this must not be served; judged when everything that lies over the configuration is known.
    pub fn refusal(&self) -> Option<String> {
        let address = self.address.filter(|address| !address.ip().is_loopback())?;
        self.token_file.is_none().then(|| {
            format!(
                "address of [viewer] is {address}, which other hosts reach: name a token_file, or use 127.0.0.1 (docs/viewer.md)"
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::Config;
    use std::path::Path;

    fn parse(text: &str) -> Result<Config, String> {
        Config::parse(Path::new("jink.toml"), text).map_err(|error| error.to_string())
    }

    #[test]
    fn a_page_is_served_where_it_is_said_and_nowhere_else() {
        assert_eq!(parse("").unwrap().viewer.address, None);
        assert_eq!(parse("[viewer]\naddress = \"\"\n").unwrap().viewer.address, None);
        for (address, ip, port) in [
            ("127.0.0.1:8080", "127.0.0.1", 8080),
            ("localhost:0", "127.0.0.1", 0),
            ("[::1]:80", "::1", 80),
        ] {
            let config = parse(&format!("[viewer]\naddress = \"{address}\"\n")).unwrap();
            let served = config.viewer.address.unwrap();
            assert_eq!((served.ip().to_string(), served.port()), (ip.to_owned(), port));
        }
        let bad = parse("[viewer]\naddress = \"8080\"\n").unwrap_err();
        assert!(
            bad.starts_with("jink.toml:2: address of [viewer] is ADDRESS:PORT"),
            "{bad}"
        );
    }

    #[test]
    fn beyond_this_host_a_token_is_needed_and_overrides_count() {
        let open = parse("\n[viewer]\naddress = \"0.0.0.0:8080\"\n").unwrap_err();
        assert!(
            open.starts_with("jink.toml:3: address of [viewer] is 0.0.0.0:8080"),
            "{open}"
        );
        let folder = std::env::temp_dir().join(format!("jink_viewer_config_{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(
            folder.join(crate::CONFIG_FILE),
            "[viewer]\ntoken_file = \"/etc/jink/token\"\n",
        )
        .unwrap();
        let resolve = |set: &[&str]| {
            let set: Vec<String> = set.iter().map(|text| (*text).to_owned()).collect();
            Config::resolve(&folder, None, None, &set).map_err(|error| error.to_string())
        };
        assert!(resolve(&["viewer.address=0.0.0.0:8080"]).is_ok());
        let open = resolve(&["viewer.address=0.0.0.0:8080", "viewer.token_file="]).unwrap_err();
        assert!(
            open.starts_with("--set viewer.address=0.0.0.0:8080: address of"),
            "{open}"
        );
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
