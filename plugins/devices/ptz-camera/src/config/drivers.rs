//! The settings of each driver, from the config of a camera.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

use agent::config_duration;
use onvif_link::{Address, CameraAccess, Position, StreamAccess};

use super::{Config, DriverSettings, RawOption, RawPreset, SENSITIVITY, SETTLE, SETTLE_MAX};
use crate::motion::{CameraSource, MotionProgram, MotionSettings, check_option};
use crate::onvif::{OnvifSettings, Target};
use crate::position::{PTZ, PtzPosition};
use crate::v4l2::V4l2Settings;
use crate::{MOTION, ONVIF, SIMULATED, V4L2};

/// Kinds of addresses of which Motion gets pictures; `file` is a film, to try it.
const SCHEMES: &[&str] = &["rtsp", "http", "https", "file"];

/// Port for pictures of a Motion that runs by itself, if the config has none: that of Motion's own
/// example.
const PICTURES_PORT: u16 = 8_081;

/// Greatest width and height of a picture, in pixels.
const PIXELS_MAX: u32 = 16_384;

impl Config {
    /// Returns the settings of the driver `simulated`.
    pub(super) fn frames(&self) -> Result<DriverSettings, String> {
        let sensitivity = self.share_for_motion()?;
        let direction = |(name, raw): (&String, &RawPreset)| {
            if raw.preset.is_some() || raw.position.is_some() {
                return Err(format!(
                    "the preset `{name}`: `preset` and `position` are for `driver = \"onvif\"`; \
                     write `pan`, `tilt` and `zoom`"
                ));
            }
            let aim = PtzPosition {
                pan: raw.pan.unwrap_or(0.0),
                tilt: raw.tilt.unwrap_or(0.0),
                zoom: raw.zoom.unwrap_or(1.0),
            };
            if !PTZ.allows(aim) {
                return Err(format!("the preset `{name}` is out of reach: {PTZ}"));
            }
            Ok((name.clone(), aim))
        };
        let directions = self.presets.iter().map(direction).collect::<Result<_, String>>()?;
        Ok(DriverSettings::Frames(directions, sensitivity))
    }

    /// Returns the settings of the driver `onvif`.
    pub(super) fn onvif(&self) -> Result<DriverSettings, String> {
        let Config { address, user, password_file, ca, fingerprint, .. } = self;
        let Some(address) = address else {
            return Err("driver `onvif` needs the `address` of the camera, such as \"10.0.0.9\"; \
                        `althing agents --discovered` lists the cameras that a `camera-finder` sees"
                .to_owned());
        };
        let access = CameraAccess::new(
            address,
            user.clone(),
            password_file.clone(),
            ca.clone(),
            fingerprint.as_deref(),
        )?;
        let settle = self.settle()?;
        let targets = self.presets.iter().map(|(name, raw)| Ok((name.clone(), target(name, raw)?)));
        let targets = targets.collect::<Result<_, String>>()?;
        let watches_motion = self.motion;
        Ok(DriverSettings::Onvif(OnvifSettings { access, targets, settle, watches_motion }))
    }

    /// Returns the settings of the driver `motion`. `state` is the daemon's state folder.
    pub(super) fn motion_program(
        &self,
        agent: String,
        state: Option<PathBuf>,
    ) -> Result<DriverSettings, String> {
        let program = match (&self.source, &self.address) {
            (Some(source), None) => self.supervised(source, state)?,
            (None, Some(address)) => self.attached(address)?,
            (Some(_), Some(_)) => {
                return Err("write `source`, the camera of a Motion that the daemon runs, or \
                            `address`, of a Motion that runs by itself, and not both"
                    .to_owned());
            }
            (None, None) => {
                return Err("driver `motion` needs the `source` of the pictures, such as \
                            \"rtsp://10.0.0.9/1\" or \"/dev/video0\"; or the `address` of a Motion \
                            that runs by itself, such as \"127.0.0.1:8080\""
                    .to_owned());
            }
        };
        let has_video = matches!(
            &program,
            MotionProgram::Supervised { source: CameraSource::Stream(stream), .. }
                if stream.to_string().starts_with("rtsp://")
        );
        if self.record_seconds.is_some() && !has_video {
            return Err("`record-seconds`: the driver `motion` records the `source` \
                        \"rtsp://…\", and no other"
                .to_owned());
        }
        let preset = self.only_preset()?;
        let watches_motion = self.motion;
        Ok(DriverSettings::Motion(MotionSettings { agent, preset, watches_motion, program }))
    }

    /// Returns the Motion that the daemon runs.
    fn supervised(&self, source: &str, state: Option<PathBuf>) -> Result<MotionProgram, String> {
        let Config { pictures, camera, events, ca, fingerprint, .. } = self;
        let foreign = [
            ("pictures", pictures.is_some()),
            ("camera", camera.is_some()),
            ("events", events.is_some()),
            ("ca", ca.is_some()),
            ("fingerprint", fingerprint.is_some()),
        ];
        if let Some((key, _)) = foreign.iter().find(|(_, is_there)| *is_there) {
            return Err(format!(
                "`{key}` is for a Motion that runs by itself, with its `address`; this one has a \
                 `source`, and the daemon runs it"
            ));
        }
        let mut options = Vec::new();
        for (name, value) in self.settings.iter().flatten() {
            let value = match value {
                RawOption::Switch(is_on) => if *is_on { "on" } else { "off" }.to_owned(),
                RawOption::Number(number) => number.to_string(),
                RawOption::Text(text) => text.clone(),
            };
            check_option(name, &value)?;
            options.push((name.clone(), value));
        }
        let source = match source.starts_with('/') {
            true if self.user.is_some() || self.password_file.is_some() => {
                return Err(format!("`user` and `password-file`: {source} needs no login"));
            }
            true => CameraSource::Device(device(source)?),
            false => {
                let (user, password_file) = (self.user.clone(), self.password_file.clone());
                let stream = StreamAccess::new(source, SCHEMES, user, password_file);
                CameraSource::Stream(stream.map_err(|problem| format!("`source`: {problem}"))?)
            }
        };
        let folder = state.map(|state| state.join("motion"));
        Ok(MotionProgram::Supervised { source, options, folder })
    }

    /// Returns a Motion that runs by itself.
    fn attached(&self, address: &str) -> Result<MotionProgram, String> {
        let Config { user, password_file, ca, fingerprint, settings, .. } = self;
        if settings.is_some() {
            return Err(
                "`settings` is for a Motion that the daemon runs, with its `source`; this \
                        one has its own motion.conf"
                    .to_owned(),
            );
        }
        let Some(events) = self.events.clone().filter(|events| events.is_absolute()) else {
            return Err(
                "a Motion that runs by itself needs `events`, the absolute path of a named \
                        pipe into which its hooks write (docs/cameras.md, “Motion as the detector”)"
                    .to_owned(),
            );
        };
        let access = |address: &str| {
            let (user, password_file) = (user.clone(), password_file.clone());
            CameraAccess::new(address, user, password_file, ca.clone(), fingerprint.as_deref())
        };
        let pictures = match &self.pictures {
            Some(pictures) => pictures.clone(),
            None => Address { port: PICTURES_PORT, ..Address::parse(address)? }.to_string(),
        };
        let (control, pictures) = (access(address)?, access(&pictures)?);
        let camera = self.camera.unwrap_or_default();
        Ok(MotionProgram::Attached { control, pictures, camera, events })
    }

    /// Returns the settings of the driver `v4l2`.
    pub(super) fn v4l2(&self) -> Result<DriverSettings, String> {
        let Some(device) = self.device.as_deref() else {
            return Err(
                "driver `v4l2` needs the `device` of the camera, such as \"/dev/video0\"; \
                        `ls /dev/v4l/by-id` shows names that stay the same"
                    .to_owned(),
            );
        };
        let device = self::device(device)?;
        let size = self.size.as_deref().map(size).transpose()?;
        let position = |(name, raw): (&String, &RawPreset)| {
            if raw.preset.is_some() || raw.pan.or(raw.tilt).or(raw.zoom).is_some() {
                return Err(format!(
                    "the preset `{name}`: a USB camera stores no presets; write position = \
                     [PAN, TILT, ZOOM], pan and tilt from -1 to 1, zoom from 0 to 1"
                ));
            }
            let position = raw.position.map(|position| self::position(name, position)).transpose();
            Ok((name.clone(), position?))
        };
        let positions: BTreeMap<_, _> =
            self.presets.iter().map(position).collect::<Result<_, String>>()?;
        if positions.len() > 1
            && let Some((name, _)) = positions.iter().find(|(_, position)| position.is_none())
        {
            return Err(format!(
                "the preset `{name}` names no direction of the camera: write position = \
                 [PAN, TILT, ZOOM], or only one preset for a camera without motors"
            ));
        }
        Ok(DriverSettings::V4l2(V4l2Settings {
            input: V4l2Settings::input_of(&device, size),
            device,
            positions,
            sensitivity: self.share_for_motion()?,
            settle: self.settle()?,
        }))
    }

    /// Returns the share of the picture that must change to count as motion; `None` if the camera
    /// does not watch for motion.
    fn share_for_motion(&self) -> Result<Option<f64>, String> {
        let sensitivity = self.sensitivity.unwrap_or(SENSITIVITY);
        if !(sensitivity > 0.0 && sensitivity < 1.0) {
            return Err("sensitivity is a share of the picture, between 0 and 1".to_owned());
        }
        Ok(self.motion.then_some(sensitivity))
    }

    fn settle(&self) -> Result<Duration, String> {
        let settle = |text| config_duration("settle", text, Duration::ZERO..=SETTLE_MAX);
        Ok(self.settle.as_deref().map(settle).transpose()?.unwrap_or(SETTLE))
    }

    /// Returns the name of the only preset of a camera that cannot turn.
    fn only_preset(&self) -> Result<String, String> {
        let mut presets = self.presets.iter();
        match (presets.next(), presets.next()) {
            (Some((name, raw)), None)
                if raw.preset.is_none()
                    && raw.position.is_none()
                    && raw.pan.or(raw.tilt).or(raw.zoom).is_none() =>
            {
                Ok(name.clone())
            }
            _ => Err("`presets`: a camera with the driver `motion` does not turn; it needs one \
                      preset at most, with the place that it `shows` and no direction"
                .to_owned()),
        }
    }
}

/// Returns an error if the config has a key of another driver.
pub(super) fn check_keys(config: &Config, driver: &str) -> Result<(), String> {
    match (config.sensitivity, driver) {
        (Some(_), ONVIF) => {
            return Err(
                "`sensitivity`: a camera with the driver `onvif` decides by itself what is \
                        motion; set it in the camera's own settings"
                    .to_owned(),
            );
        }
        (Some(_), MOTION) => {
            return Err(
                "`sensitivity`: Motion counts pixels; write settings = { threshold = 1500 }"
                    .to_owned(),
            );
        }
        _ => (),
    }
    let keys: [(&str, bool, &[&str]); 15] = [
        ("address", config.address.is_some(), &[ONVIF, MOTION]),
        ("user", config.user.is_some(), &[ONVIF, MOTION]),
        ("password-file", config.password_file.is_some(), &[ONVIF, MOTION]),
        ("ca", config.ca.is_some(), &[ONVIF, MOTION]),
        ("fingerprint", config.fingerprint.is_some(), &[ONVIF, MOTION]),
        ("settle", config.settle.is_some(), &[ONVIF, V4L2]),
        ("record-seconds", config.record_seconds.is_some(), &[SIMULATED, ONVIF, MOTION]),
        ("sensitivity", config.sensitivity.is_some(), &[SIMULATED, V4L2]),
        ("source", config.source.is_some(), &[MOTION]),
        ("settings", config.settings.is_some(), &[MOTION]),
        ("pictures", config.pictures.is_some(), &[MOTION]),
        ("camera", config.camera.is_some(), &[MOTION]),
        ("events", config.events.is_some(), &[MOTION]),
        ("device", config.device.is_some(), &[V4L2]),
        ("size", config.size.is_some(), &[V4L2]),
    ];
    let foreign =
        keys.iter().find(|(_, is_there, drivers)| *is_there && !drivers.contains(&driver));
    match foreign {
        None => Ok(()),
        Some((key, _, [only])) => Err(format!("`{key}` is for `driver = \"{only}\"`")),
        Some((key, _, drivers)) => {
            let drivers: Vec<_> = drivers.iter().map(|driver| format!("`{driver}`")).collect();
            Err(format!("`{key}` is for the drivers {}", drivers.join(", ")))
        }
    }
}

/// Returns the path of a camera's file, such as `/dev/video0`.
fn device(path: &str) -> Result<String, String> {
    let is_plain = path.chars().all(|symbol| symbol.is_ascii_graphic());
    if !path.starts_with("/dev/") || !is_plain {
        return Err(format!(
            "`{path}` is no camera of this machine; write /dev/video0, or a name in \
                            /dev/v4l/by-id"
        ));
    }
    Ok(path.to_owned())
}

/// Returns the width and the height that a text such as `1280x720` means.
fn size(text: &str) -> Result<(u32, u32), String> {
    let parts = text.split_once('x').and_then(|(width, height)| {
        let part = |text: &str| text.parse().ok().filter(|part| (1..=PIXELS_MAX).contains(part));
        Some((part(width)?, part(height)?))
    });
    parts.ok_or_else(|| format!("size `{text}`: write WIDTHxHEIGHT, such as 1280x720"))
}

/// Checks the position of a preset.
fn position(name: &str, [pan, tilt, zoom]: [f64; 3]) -> Result<Position, String> {
    let is_possible =
        (-1.0..=1.0).contains(&pan) && (-1.0..=1.0).contains(&tilt) && (0.0..=1.0).contains(&zoom);
    if !is_possible {
        return Err(format!(
            "the preset `{name}`: `position` is pan and tilt from -1 to 1, zoom from 0 to 1"
        ));
    }
    Ok(Position { pan, tilt, zoom })
}

/// Returns the preset or the position in the camera for a preset of the config with the driver
/// `onvif`.
fn target(name: &str, raw: &RawPreset) -> Result<Target, String> {
    let RawPreset { shows, pan, tilt, zoom, preset, position } = raw;
    if pan.or(*tilt).or(*zoom).is_some() {
        return Err(format!(
            "the preset `{name}`: `pan`, `tilt` and `zoom` are degrees of a simulated camera; store \
             the direction in the camera with its own app, and write preset = \"NAME\""
        ));
    }
    match (preset, position) {
        (Some(_), Some(_)) => {
            Err(format!("the preset `{name}`: write `preset` or `position`, and not both"))
        }
        (Some(preset), None) if preset.trim().is_empty() => {
            Err(format!("the preset `{name}`: `preset` is empty; write its name in the camera"))
        }
        (Some(preset), None) => Ok(Target::Preset(preset.trim().to_owned())),
        (None, Some(position)) => self::position(name, *position).map(Target::Position),
        (None, None) => Err(format!(
            "the preset `{name}` shows `{shows}`, but names no direction of the camera: store it in \
             the camera with its own app, and write preset = \"NAME\""
        )),
    }
}
