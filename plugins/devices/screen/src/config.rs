//! The `config` of a screen's entry: its room, its media, and the keys for the drivers.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::path::{Path, PathBuf};

use actuator::PlaceName;
use agent::{Blueprint, BuildCheck, BuildError};
use cast_link::CastAddress;
use serde::Deserialize;

use crate::cast::{self, CastSettings};
use crate::cec::{CecSettings, THIS_MACHINE};
use crate::content::{ADDRESSES, Content, PlayerSettings, ending};
use crate::{BROWSER, CAST, CEC, MPV};

/// The `config` of a screen's entry in the ecosystem file.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub(crate) struct Config {
    /// Room of the screen.
    pub(crate) location: PlaceName,
    /// Media that the screen can show, by their names in plans.
    media: BTreeMap<String, WrittenMedium>,
    /// Drivers `browser`, `mpv` and `cec`: the program. The default is a program that is found in
    /// the folders of `PATH`.
    program: Option<String>,
    /// Drivers `browser` and `mpv`: further arguments of the program.
    arguments: Option<Vec<String>>,
    /// Drivers `browser` and `mpv`: the X display, such as `":0"`. The default is the display of
    /// the daemon.
    display: Option<String>,
    /// Driver `browser`: folder of a profile that is kept, for pages at which a person has logged
    /// in. The default is a profile that is removed with the browser.
    profile: Option<PathBuf>,
    /// Driver `cast`: the address of the Chromecast, such as `"10.0.0.7"`.
    address: Option<String>,
    /// Driver `cast`: the volume with which media are presented, from 0 to 1. By default, the
    /// volume is left as it is.
    volume: Option<f64>,
    /// Driver `cast`: whether a medium counts as shown whatever the Chromecast says about the
    /// television. Some televisions report it wrongly.
    ignore_cec: Option<bool>,
    /// Drivers `cec`, `browser` and `mpv`: the kernel's device of the HDMI cable. The default of
    /// `cec` is `/dev/cec0`; without the key, the other two leave the television alone.
    television: Option<String>,
}

/// A medium, as the ecosystem file writes it.
#[derive(Clone, Debug, Deserialize)]
#[serde(
    untagged,
    deny_unknown_fields,
    expecting = "write a text, an address, a path, { text = \"…\" }, or { address = \"…\", type = \"…\" }"
)]
enum WrittenMedium {
    /// A text, an address or a path; its beginning decides.
    Plain(String),
    /// A text, whatever its beginning.
    Text { text: String },
    /// An address with the type of its medium.
    Typed {
        address: String,
        /// MIME type, such as `video/mp4`.
        #[serde(rename = "type")]
        content_type: String,
    },
}

/// Rule for the name of a medium, which is an object in plans.
const NAME_RULE: &str =
    "use lower-case letters, digits, `-` and `_`, and begin with a letter, such as `slides`";

/// Default of `television` for the driver `cec`: the first cable that the kernel has found.
const CEC_DEVICE: &str = "/dev/cec0";

/// Further beginnings of an address, for the driver `mpv` only.
const STREAMS: &[&str] = &["rtsp://", "rtmp://", "udp://", "rtp://", "srt://"];

/// Beginnings of the path of a file.
const PATHS: &[&str] = &["/", "./", "../"];

/// Endings of files that mpv cannot show.
const NOT_FOR_MPV: &[&str] = &["pdf", "html", "htm", "txt", "svg"];

impl Config {
    /// Checks that no key is for another driver than that of the entry.
    ///
    /// # Errors
    ///
    /// Returns an error that names the first such key, and its drivers.
    pub(crate) fn check_keys(&self, blueprint: &Blueprint) -> Result<(), BuildError> {
        let (both, of_machine): (&[_], &[_]) = (&[BROWSER, MPV], &[BROWSER, MPV, CEC]);
        let said = [
            ("program", of_machine, self.program.is_some()),
            ("arguments", both, self.arguments.is_some()),
            ("display", both, self.display.is_some()),
            ("profile", &[BROWSER], self.profile.is_some()),
            ("address", &[CAST], self.address.is_some()),
            ("volume", &[CAST], self.volume.is_some()),
            ("ignore-cec", &[CAST], self.ignore_cec.is_some()),
            ("television", of_machine, self.television.is_some()),
        ];
        let this = blueprint.driver.as_str();
        let of_another = said.iter().find(|(_, drivers, said)| *said && !drivers.contains(&this));
        if let Some((key, drivers, _)) = of_another {
            let drivers: Vec<_> = drivers.iter().map(|driver| format!("`{driver}`")).collect();
            let drivers = drivers.join(" and ");
            let problem = format!("`{key}` is for the driver {drivers}, and this one is `{this}`");
            return Err(blueprint.problem(problem));
        }
        Ok(())
    }

    /// Removes the keys of drivers with a program from the config, and returns them.
    pub(crate) fn player(&mut self) -> PlayerSettings {
        PlayerSettings {
            program: self.program.take(),
            arguments: self.arguments.take().unwrap_or_default(),
            display: self.display.take(),
            profile: self.profile.take(),
        }
    }

    /// Returns the settings of the driver `cast`.
    ///
    /// # Errors
    ///
    /// Returns an error if the address is missing or invalid, or if the volume is no share.
    pub(crate) fn cast(&self, blueprint: &Blueprint) -> Result<CastSettings, BuildError> {
        let Some(address) = &self.address else {
            let problem = "driver `cast` needs the `address` of the Chromecast, such as \
                \"10.0.0.7\"; `althing agents --discovered` lists the Chromecasts that a \
                `screen-finder` sees";
            return Err(blueprint.problem(problem.to_owned()));
        };
        let address = CastAddress::parse(address).map_err(|problem| blueprint.problem(problem))?;
        if self.volume.is_some_and(|volume| !(0.0..=1.0).contains(&volume)) {
            let problem = "`volume` is a share from 0.0 to 1.0";
            return Err(blueprint.problem(problem.to_owned()));
        }
        let ignores_cec = self.ignore_cec.unwrap_or_default();
        Ok(CastSettings { address, volume: self.volume, ignores_cec })
    }

    /// Returns the settings of the driver `cec`.
    ///
    /// # Errors
    ///
    /// Returns an error if the device is no path.
    pub(crate) fn cec(&mut self, blueprint: &Blueprint) -> Result<CecSettings, BuildError> {
        let named = self.television(blueprint)?;
        let device = named.map_or_else(|| CEC_DEVICE.to_owned(), |named| named.device);
        Ok(CecSettings { device, program: self.program.take() })
    }

    /// Returns the settings of the television that a program shows its media on; `None` if it is
    /// left alone.
    ///
    /// # Errors
    ///
    /// Returns an error if the device is no path.
    pub(crate) fn television(
        &self,
        blueprint: &Blueprint,
    ) -> Result<Option<CecSettings>, BuildError> {
        let Some(device) = self.television.clone() else { return Ok(None) };
        if !device.starts_with('/') {
            let problem =
                format!("the television `{device}` is no path; write one such as /dev/cec0");
            return Err(blueprint.problem(problem));
        }
        Ok(Some(CecSettings { device, program: None }))
    }

    /// Returns the media by their names.
    ///
    /// # Errors
    ///
    /// Returns an error if a name is no name of PDDL, if two media are the same, or if the driver
    /// cannot show a medium, for instance because its file is missing. A check on another machine
    /// (`BuildCheck`) does not look for the files.
    pub(crate) fn contents(
        &self,
        blueprint: &Blueprint,
    ) -> Result<BTreeMap<String, Content>, BuildError> {
        let is_check = blueprint.host.resources.get::<BuildCheck>().is_some();
        let content = |(name, written): (&String, &WrittenMedium)| {
            PlaceName::try_from(name.clone()).map_err(|_| {
                let problem = format!("`{name}` cannot name a medium: {NAME_RULE}");
                blueprint.problem(problem)
            })?;
            let content = content_of(written, &blueprint.driver, is_check)
                .and_then(|content| self.fetchable(content))
                .map_err(|problem| blueprint.problem(format!("media.{name}: {problem}")))?;
            Ok((name.clone(), content))
        };
        let contents = self.media.iter().map(content).collect::<Result<BTreeMap<_, _>, _>>()?;
        let distinct: BTreeSet<_> = contents.values().map(Content::written).collect();
        if distinct.len() < contents.len() {
            return Err(blueprint.problem("two `media` with one text cannot be told apart"));
        }
        Ok(contents)
    }

    /// Checks that a Chromecast would not fetch the medium from itself. A device at an address of this
    /// machine, such as one for trying, may.
    fn fetchable(&self, content: Content) -> Result<Content, String> {
        let is_device_here = self.address.as_deref().is_some_and(cast::is_own_machine);
        match &content {
            Content::Fetched { address, .. }
                if cast::is_own_machine(address) && !is_device_here =>
            {
                Err(format!(
                    "the Chromecast would look for {address} on itself: write the IP address of the \
                     machine with the medium"
                ))
            }
            _ => Ok(content),
        }
    }
}

/// Returns the medium for this driver. The error is the reason why the driver cannot show it.
fn content_of(written: &WrittenMedium, driver: &str, is_check: bool) -> Result<Content, String> {
    let content = match written {
        WrittenMedium::Typed { address, content_type } if driver == CAST => {
            return cast::typed_content(address, content_type);
        }
        WrittenMedium::Typed { .. } => {
            return Err("`type` is for the driver `cast`; write the address alone".to_owned());
        }
        WrittenMedium::Text { text } | WrittenMedium::Plain(text) if driver == CAST => {
            return cast::plain_content(text);
        }
        WrittenMedium::Plain(text) if driver == CEC && text == THIS_MACHINE => {
            return Ok(Content::Text(text.clone()));
        }
        WrittenMedium::Plain(_) | WrittenMedium::Text { .. } if driver == CEC => {
            return Err(format!(
                "a television with the driver `cec` shows the picture of this machine and nothing \
                 else: write \"{THIS_MACHINE}\""
            ));
        }
        WrittenMedium::Text { text } => Content::Text(text.clone()),
        // A simulated screen shows any text, and has no files.
        WrittenMedium::Plain(text) if driver != BROWSER && driver != MPV => {
            Content::Text(text.clone())
        }
        WrittenMedium::Plain(text) => plain_content(text, driver, is_check)?,
    };
    if driver != MPV {
        return Ok(content);
    }
    match &content {
        Content::Text(_) => Err("mpv shows films and pictures, and no texts: write a path that \
            begins with `/` or `./`, or an address, or use `driver = \"browser\"`"
            .to_owned()),
        Content::File { path, written } if NOT_FOR_MPV.contains(&ending(path).as_str()) => {
            Err(format!("mpv cannot show {written}; `driver = \"browser\"` can"))
        }
        Content::File { .. } | Content::Address(_) | Content::Fetched { .. } => Ok(content),
    }
}

fn plain_content(text: &str, driver: &str, is_check: bool) -> Result<Content, String> {
    let begins = |beginnings: &[&str]| beginnings.iter().any(|start| text.starts_with(start));
    if begins(ADDRESSES) || driver == MPV && begins(STREAMS) {
        return Ok(Content::Address(text.to_owned()));
    }
    if !begins(PATHS) {
        return Ok(Content::Text(text.to_owned()));
    }
    if is_check {
        return Ok(Content::File { written: text.to_owned(), path: PathBuf::from(text) });
    }
    // The file is opened, because a file that the daemon may not read is as good as missing.
    let path = Path::new(text).canonicalize();
    let path = path.and_then(|path| File::open(&path)?.metadata().map(|about| (path, about)));
    let (path, about) = path.map_err(|error| format!("the file {text} cannot be read: {error}"))?;
    if !about.is_file() {
        return Err(format!("{text} is not a file"));
    }
    Ok(Content::File { written: text.to_owned(), path })
}
