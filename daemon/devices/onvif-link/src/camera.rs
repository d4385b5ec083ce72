//! A camera: its services, presets, movements and pictures.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use hyper::body::Bytes;

use crate::access::CameraAccess;
use crate::address::Address;
use crate::error::{LinkError, excerpt};
use crate::services::{MEDIA, PTZ, Services, call};
use crate::session::{CameraSession, DEVICE};
use crate::xml::{Element, escape};

/// Maximum number of presets that are looked at; further ones are ignored. Cameras have up to 300.
const PRESETS_MAX: usize = 1_024;

/// Maximum size of a picture, in bytes; a greater one is an error. A picture of 8 megapixels has
/// 2 to 4 MB.
const PICTURE_BYTES_MAX: usize = 16 << 20;

/// Time limit for a picture. A camera that sleeps, or encrypts slowly, needs some seconds.
const PICTURE_TIME_MAX: Duration = Duration::from_secs(10);

/// Time limit that a camera gets with each movement. A camera that respects it ends the movement
/// even if this process ends before it stops the camera.
const DRIFT_MAX: &str = "PT2S";

/// Direction and zoom of a camera, in ONVIF's generic units: pan and tilt from -1 to 1, zoom from 0
/// to 1. A speed has the same form, with -1 to 1 for each.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Position {
    /// Pan, to the right.
    pub pan: f64,
    /// Tilt, up.
    pub tilt: f64,
    /// Zoom, in.
    pub zoom: f64,
}

/// Maximum difference of two positions that count as the same: the precision of common motors, and
/// the rounding of cameras.
const SAME_POSITION: f64 = 0.01;

impl Position {
    /// Whether `other` is the same direction and zoom, within the precision of motors.
    pub fn is(&self, other: &Position) -> bool {
        (self.pan - other.pan).abs() < SAME_POSITION
            && (self.tilt - other.tilt).abs() < SAME_POSITION
            && (self.zoom - other.zoom).abs() < SAME_POSITION
    }
}

/// A position that is stored in a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraPreset {
    /// Identifier of the preset.
    pub token: String,
    /// Name of the preset for people; empty if it has none.
    pub name: String,
    /// Direction of the preset; `None` if the camera does not report it.
    pub position: Option<Position>,
}

/// Position and movement of a camera, as the camera reports them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PtzStatus {
    /// Present direction; `None` if the camera does not report it.
    pub position: Option<Position>,
    /// Whether the camera moves; `None` if it does not report it.
    pub is_moving: Option<bool>,
}

/// First bytes of pictures, with the extension of their files. ONVIF requires JPEG; some cameras
/// send the others.
const PICTURE_KINDS: &[(&[u8], &str)] =
    &[(b"\xff\xd8", "jpg"), (b"\x89PNG\r\n", "png"), (b"BM", "bmp")];

/// A picture of a camera, as the camera has sent it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CameraPicture {
    /// Extension of the picture's file, such as `jpg`.
    pub extension: &'static str,
    /// Content of the picture's file.
    pub content: Bytes,
}

/// Ways in which a camera can be moved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Abilities {
    /// The camera has presets.
    pub has_presets: bool,
    /// The camera turns to a position.
    pub has_absolute: bool,
    /// The camera turns until it is stopped.
    pub has_continuous: bool,
}

/// A connection to a camera.
#[derive(Debug)]
pub struct OnvifCamera {
    pub(crate) session: CameraSession,
    pub(crate) media: Address,
    pub(crate) media_namespace: &'static str,
    ptz: Option<Address>,
    pub(crate) events: Option<Address>,
    /// Token of the media profile for pictures and movements.
    pub(crate) profile: String,
    /// Tokens of the profile's source of pictures.
    pub(crate) own_sources: BTreeSet<String>,
    /// Tokens of the sources of other profiles: other lenses of the same device.
    pub(crate) other_sources: BTreeSet<String>,
    abilities: Abilities,
    /// Whether the camera has refused the time limit of a movement.
    refuses_timeout: AtomicBool,
}

impl OnvifCamera {
    /// Connects to a camera: reads its clock, its services, its profile and its abilities.
    ///
    /// # Errors
    ///
    /// Returns an error if the camera cannot be reached or understood, or rejects the login.
    pub async fn connect(access: &CameraAccess) -> Result<OnvifCamera, LinkError> {
        let session = CameraSession::open(access).await?;
        let services = Services::read(&session).await?;
        let Services { media, media_namespace, ptz, events } = services;
        let mut camera = OnvifCamera {
            session,
            media,
            media_namespace,
            ptz,
            events,
            profile: String::new(),
            own_sources: BTreeSet::new(),
            other_sources: BTreeSet::new(),
            abilities: Abilities::default(),
            refuses_timeout: AtomicBool::new(false),
        };
        let node = camera.read_profiles().await?;
        camera.abilities = camera.read_abilities(node.as_deref()).await?;
        Ok(camera)
    }

    /// Returns the ways in which the camera can be moved.
    pub fn abilities(&self) -> Abilities {
        self.abilities
    }

    /// Whether the camera has a service of events.
    pub fn has_events(&self) -> bool {
        self.events.is_some()
    }

    /// Returns how far the camera's clock is ahead of this machine's, in seconds.
    pub fn clock_offset(&self) -> i64 {
        self.session.clock_offset()
    }

    /// Returns maker, model and firmware of the camera, in one line.
    ///
    /// # Errors
    ///
    /// Returns an error if the camera does not answer.
    pub async fn identity(&self) -> Result<String, LinkError> {
        let at = self.session.address();
        let answer = call(&self.session, at, DEVICE, "GetDeviceInformation", "").await?;
        let parts = ["Manufacturer", "Model", "FirmwareVersion"];
        let parts: Vec<_> = parts.iter().filter_map(|part| answer.text_at(&[part])).collect();
        Ok(excerpt(&parts.join(" ")))
    }

    /// Reads the presets that are stored in the camera.
    ///
    /// # Errors
    ///
    /// Returns an error if the camera does not answer, or cannot turn.
    pub async fn presets(&self) -> Result<Vec<CameraPreset>, LinkError> {
        let answer = self.ptz("GetPresets", &self.with_profile("")).await?;
        let preset = |element: &Element| {
            Some(CameraPreset {
                token: element.attribute("token")?.to_owned(),
                name: element.text_at(&["Name"]).unwrap_or_default().to_owned(),
                position: element.child("PTZPosition").and_then(position),
            })
        };
        Ok(answer.all("Preset").filter_map(preset).take(PRESETS_MAX).collect())
    }

    /// Begins to turn to a preset. The camera answers before it has arrived.
    ///
    /// # Errors
    ///
    /// Returns an error if the camera refuses it, or cannot turn.
    pub async fn go_to_preset(&self, token: &str) -> Result<(), LinkError> {
        let content = format!("<o:PresetToken>{}</o:PresetToken>", escape(token));
        self.ptz("GotoPreset", &self.with_profile(&content)).await.map(drop)
    }

    /// Begins to turn to a position. The camera answers before it has arrived.
    ///
    /// # Errors
    ///
    /// Returns an error if the camera refuses it, or cannot turn.
    pub async fn go_to(&self, position: Position) -> Result<(), LinkError> {
        let content = format!("<o:Position>{}</o:Position>", vector(position));
        self.ptz("AbsoluteMove", &self.with_profile(&content)).await.map(drop)
    }

    /// Begins to move with a speed, until [`OnvifCamera::stop`].
    ///
    /// # Errors
    ///
    /// Returns an error if the camera refuses it, or cannot turn.
    pub async fn drive(&self, speed: Position) -> Result<(), LinkError> {
        let velocity = format!("<o:Velocity>{}</o:Velocity>", vector(speed));
        if !self.refuses_timeout.load(Ordering::Relaxed) {
            let limited = format!("{velocity}<o:Timeout>{DRIFT_MAX}</o:Timeout>");
            let moved = self.ptz("ContinuousMove", &self.with_profile(&limited)).await;
            if !matches!(moved, Err(LinkError::Fault { .. } | LinkError::Unsupported(_))) {
                return moved.map(drop);
            }
        }
        // Some cameras refuse the time limit, although it is optional.
        self.ptz("ContinuousMove", &self.with_profile(&velocity)).await?;
        self.refuses_timeout.store(true, Ordering::Relaxed);
        Ok(())
    }

    /// Stops the camera.
    ///
    /// # Errors
    ///
    /// Returns an error if the camera accepts neither a stop nor a movement with the speed zero.
    pub async fn stop(&self) -> Result<(), LinkError> {
        let content = self.with_profile("<o:PanTilt>true</o:PanTilt><o:Zoom>true</o:Zoom>");
        let stopped = self.ptz("Stop", &content).await;
        if !matches!(stopped, Err(LinkError::Fault { .. } | LinkError::Unsupported(_))) {
            return stopped.map(drop);
        }
        // Some cameras do not have this operation. If the other one fails as well, the first
        // reason is the better one.
        let velocity = format!("<o:Velocity>{}</o:Velocity>", vector(Position::default()));
        let still = self.ptz("ContinuousMove", &self.with_profile(&velocity)).await;
        still.map(drop).or(stopped.map(drop))
    }

    /// Reads the present position, and whether the camera moves.
    ///
    /// # Errors
    ///
    /// Returns an error if the camera does not answer, or cannot turn.
    pub async fn status(&self) -> Result<PtzStatus, LinkError> {
        let answer = self.ptz("GetStatus", &self.with_profile("")).await?;
        let status = answer.child("PTZStatus");
        let moving = |part: &str| {
            let said = status?.text_at(&["MoveStatus", part])?;
            match said.to_ascii_uppercase().as_str() {
                "MOVING" => Some(true),
                "IDLE" => Some(false),
                _ => None,
            }
        };
        let (turns, zooms) = (moving("PanTilt"), moving("Zoom"));
        Ok(PtzStatus {
            position: status.and_then(|status| status.child("Position")).and_then(position),
            is_moving: match (turns, zooms) {
                (None, None) => None,
                _ => Some(turns == Some(true) || zooms == Some(true)),
            },
        })
    }

    /// Takes a picture.
    ///
    /// # Errors
    ///
    /// Returns an error if the camera has no picture, or sends anything else in its place.
    pub async fn snapshot(&self) -> Result<CameraPicture, LinkError> {
        let name = "GetSnapshotUri";
        let content = format!("<o:ProfileToken>{}</o:ProfileToken>", escape(&self.profile));
        let answer = call(&self.session, &self.media, self.media_namespace, name, &content).await?;
        let named = answer.find("Uri").map(Element::text).unwrap_or_default();
        let at = self.session.resolve(named).ok_or_else(|| LinkError::Unreadable {
            call: name.to_owned(),
            problem: format!("`{}` is no address of a picture", excerpt(named)),
        })?;
        picture_of(&self.session, &at).await
    }

    async fn ptz(&self, name: &str, content: &str) -> Result<Element, LinkError> {
        let Some(at) = &self.ptz else {
            return Err(LinkError::Unsupported(format!(
                "carry out {name}: the camera has no motors (no PTZ service)"
            )));
        };
        call(&self.session, at, PTZ, name, content).await
    }

    fn with_profile(&self, content: &str) -> String {
        format!("<o:ProfileToken>{}</o:ProfileToken>{content}", escape(&self.profile))
    }

    /// Reads the profiles, and chooses the first one with motors, or else the first. Returns the
    /// token of the motors' node; `None` if there is none.
    async fn read_profiles(&mut self) -> Result<Option<String>, LinkError> {
        let content = if self.media_namespace == MEDIA { "" } else { "<o:Type>All</o:Type>" };
        let name = "GetProfiles";
        let answer = call(&self.session, &self.media, self.media_namespace, name, content).await?;
        let ptz = |profile: &Element| -> Option<Element> {
            let known =
                profile.child("PTZConfiguration").or(profile.at(&["Configurations", "PTZ"]));
            known.cloned()
        };
        let profiles: Vec<_> = answer.all("Profiles").collect();
        let with_motors = profiles.iter().find(|profile| ptz(profile).is_some());
        let chosen = with_motors.or(profiles.first()).copied();
        let token = chosen.and_then(|profile| profile.attribute("token"));
        let (Some(chosen), Some(token)) = (chosen, token) else {
            let problem = "it names no profile with a picture".to_owned();
            return Err(LinkError::Unreadable { call: name.to_owned(), problem });
        };
        self.profile = token.to_owned();
        self.own_sources = sources(chosen);
        let all = profiles.iter().flat_map(|profile| sources(profile));
        self.other_sources = all.filter(|source| !self.own_sources.contains(source)).collect();
        let node = ptz(chosen).and_then(|ptz| ptz.text_at(&["NodeToken"]).map(str::to_owned));
        Ok(node)
    }

    /// Reads the abilities of the motors. A camera that does not report them counts as having all;
    /// it refuses the movements that it cannot carry out.
    async fn read_abilities(&self, node: Option<&str>) -> Result<Abilities, LinkError> {
        if self.ptz.is_none() {
            return Ok(Abilities::default());
        }
        let all = Abilities { has_presets: true, has_absolute: true, has_continuous: true };
        let answer = match self.ptz("GetNodes", "").await {
            Ok(answer) => answer,
            Err(LinkError::Fault { .. } | LinkError::Unsupported(_)) => return Ok(all),
            Err(error) => return Err(error),
        };
        let nodes: Vec<_> = answer.all("PTZNode").collect();
        let is_ours =
            |one: &&&Element| node.is_some_and(|node| one.attribute("token") == Some(node));
        let Some(ours) = nodes.iter().find(is_ours).or(nodes.first()) else { return Ok(all) };
        let Some(spaces) = ours.child("SupportedPTZSpaces") else { return Ok(all) };
        let count = ours.text_at(&["MaximumNumberOfPresets"]);
        Ok(Abilities {
            has_presets: count != Some("0"),
            has_absolute: spaces.child("AbsolutePanTiltPositionSpace").is_some(),
            has_continuous: spaces.child("ContinuousPanTiltVelocitySpace").is_some(),
        })
    }
}

/// Gets a picture from an address.
pub(crate) async fn picture_of(
    session: &CameraSession,
    at: &Address,
) -> Result<CameraPicture, LinkError> {
    let name = "the request for a picture";
    let (kind, picture) = session.get(at, name, PICTURE_BYTES_MAX, PICTURE_TIME_MAX).await?;
    // The type that cameras state is often wrong; the first bytes are not.
    let known = PICTURE_KINDS.iter().find(|(start, _)| picture.starts_with(start));
    if let Some((_, extension)) = known {
        return Ok(CameraPicture { extension, content: picture });
    }
    let problem = format!("it is no picture, but {} bytes of `{}`", picture.len(), excerpt(&kind));
    Err(LinkError::Unreadable { call: name.to_owned(), problem })
}

/// Returns the tokens by which a profile's source of pictures is named in events.
fn sources(profile: &Element) -> BTreeSet<String> {
    let source = profile
        .child("VideoSourceConfiguration")
        .or(profile.at(&["Configurations", "VideoSource"]));
    let Some(source) = source else { return BTreeSet::new() };
    let tokens = [source.attribute("token"), source.text_at(&["SourceToken"])];
    tokens.into_iter().flatten().map(str::to_owned).collect()
}

/// Returns a position as XML, with each number limited to -1 to 1.
fn vector(position: Position) -> String {
    let Position { pan, tilt, zoom } = position;
    let number = |value: f64| if value.is_finite() { value.clamp(-1.0, 1.0) } else { 0.0 };
    let (pan, tilt, zoom) = (number(pan), number(tilt), number(zoom));
    format!("<tt:PanTilt x=\"{pan}\" y=\"{tilt}\"/><tt:Zoom x=\"{zoom}\"/>")
}

/// Returns the position in an element with `PanTilt` and `Zoom`; `None` if it has no number.
fn position(element: &Element) -> Option<Position> {
    let number = |part: &str, axis: &str| -> Option<f64> {
        let value = element.child(part)?.attribute(axis)?.trim().parse::<f64>().ok()?;
        value.is_finite().then_some(value)
    };
    let zoom = number("Zoom", "x");
    match (number("PanTilt", "x"), number("PanTilt", "y")) {
        (Some(pan), Some(tilt)) => Some(Position { pan, tilt, zoom: zoom.unwrap_or_default() }),
        _ => None,
    }
}

/// A movement that is under way. Dropping it stops the camera, unless it was disarmed.
#[derive(Debug)]
pub struct StopOnDrop(Option<Arc<OnvifCamera>>);

impl StopOnDrop {
    /// Returns the movement of `camera`.
    pub fn new(camera: &Arc<OnvifCamera>) -> StopOnDrop {
        StopOnDrop(Some(Arc::clone(camera)))
    }

    /// Ends the movement without a stop, because the camera has arrived or was stopped.
    pub fn disarm(mut self) {
        self.0 = None;
    }
}

impl Drop for StopOnDrop {
    fn drop(&mut self) {
        let (Some(camera), Ok(runtime)) = (self.0.take(), tokio::runtime::Handle::try_current())
        else {
            return;
        };
        runtime.spawn(async move {
            if let Err(error) = camera.stop().await {
                tracing::warn!("failed to stop a camera: failed to {error}");
            }
        });
    }
}
