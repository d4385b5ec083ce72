//! The configuration file of a Motion that this process runs.
//!
//! The config of the agent may set the options by which Motion decides what is motion, and those of
//! the picture. Options that run programs, open ports or write files are not among them.

use std::fmt::Write as _;

use onvif_link::VideoStream;

use super::events::HOOKS;

/// Environment variable with the path of the pipe for events. A path in a hook would need quotes,
/// and has symbols that Motion replaces.
pub(super) const EVENTS_VARIABLE: &str = "ALTHING_MOTION_EVENTS";

/// Default for `event_gap`: the time without motion after which an event ends, in seconds. Motion's
/// own default of a minute joins several visits to one.
const EVENT_GAP: &str = "5";

/// Default for `lightswitch_percent`: the share of the picture whose change is a lamp, and no
/// motion.
const LIGHTSWITCH_PERCENT: &str = "60";

/// Options that the config of the agent may set.
const OPTIONS: &[&str] = &[
    "despeckle_filter",
    "event_gap",
    "flip_axis",
    "framerate",
    "height",
    "lightswitch_frames",
    "lightswitch_percent",
    "mask_file",
    "minimum_motion_frames",
    "noise_level",
    "noise_tune",
    "pre_capture",
    "rotate",
    "smart_mask_speed",
    "threshold",
    "threshold_maximum",
    "threshold_sdevx",
    "threshold_sdevy",
    "threshold_tune",
    "v4l2_palette",
    "video_params",
    "width",
];

/// Maximum length of the value of an option, in bytes.
const VALUE_BYTES_MAX: usize = 256;

/// Checks an option of the config.
///
/// # Errors
///
/// Returns an error with the mistake and its correction.
pub(crate) fn check_option(name: &str, value: &str) -> Result<(), String> {
    if !OPTIONS.contains(&name) {
        return Err(format!(
            "settings.{name}: this option of Motion cannot be set here; possible are {}",
            OPTIONS.join(", ")
        ));
    }
    if value.len() > VALUE_BYTES_MAX || value.chars().any(char::is_control) {
        return Err(format!(
            "settings.{name}: a value has at most {VALUE_BYTES_MAX} bytes, and no control character"
        ));
    }
    Ok(())
}

/// The camera of a Motion that this process runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum WatchedCamera {
    /// A file of a USB camera, such as `/dev/video0`.
    Device(String),
    /// A video of the network, or a film.
    Stream(VideoStream),
}

/// The ports and the password of a Motion that this process runs.
#[derive(Debug)]
pub(super) struct Doors<'d> {
    /// Port for questions.
    pub(super) control: u16,
    /// Port for pictures.
    pub(super) pictures: u16,
    pub(super) user: &'d str,
    pub(super) password: &'d str,
}

/// Returns the content of the file.
///
/// # Errors
///
/// Returns an error if the login at the camera cannot be written into the file.
pub(super) fn text(
    camera: &WatchedCamera,
    doors: &Doors<'_>,
    settings: &[(String, String)],
) -> Result<String, String> {
    let Doors { control, pictures, user, password } = doors;
    let mut text = format!(
        "daemon off\nsetup_mode off\nlog_level 5\nlog_file /dev/stderr\npicture_output off\nmovie_output off\n\
         event_gap {EVENT_GAP}\nlightswitch_percent {LIGHTSWITCH_PERCENT}\n\
         webcontrol_port {control}\nwebcontrol_localhost on\nwebcontrol_interface 1\n\
         webcontrol_parms 0\nwebcontrol_auth_method 2\nwebcontrol_authentication {user}:{password}\n\
         stream_port {pictures}\nstream_localhost on\nstream_auth_method 2\n\
         stream_authentication {user}:{password}\n"
    );
    // Writing to memory cannot fail.
    match camera {
        WatchedCamera::Device(device) => drop(writeln!(text, "videodevice {device}")),
        WatchedCamera::Stream(stream) => {
            let _ = writeln!(text, "netcam_url {}", stream.address());
            if stream.address().starts_with("file://") {
                text += "netcam_params loop=yes\n";
            }
            if let Some(login) = login(stream)? {
                let _ = writeln!(text, "netcam_userpass {login}");
            }
        }
    }
    for (hook, word, _) in HOOKS {
        // `<>` does not wait for a reader.
        let _ = writeln!(text, "{hook} echo {word} 1<>\"${EVENTS_VARIABLE}\"");
    }
    for (name, value) in settings {
        let _ = writeln!(text, "{name} {value}");
    }
    Ok(text)
}

/// Returns the login at a camera as Motion takes it; `None` if the camera needs none. Motion puts it
/// into an RTSP address as it stands in the file, and splits it at the first `:`.
///
/// # Errors
///
/// Returns an error if the login cannot be written into the file.
fn login(stream: &VideoStream) -> Result<Option<String>, String> {
    if stream.address().starts_with("rtsp://") {
        return Ok(stream.encoded_login().map(|(user, password)| format!("{user}:{password}")));
    }
    let Some((user, password)) = stream.login() else { return Ok(None) };
    if user.contains(':') || password.chars().any(char::is_control) {
        return Err("log in at the camera: Motion takes no user name with a `:`, and no password \
                    with a control character"
            .to_owned());
    }
    Ok(Some(format!("{user}:{password}")))
}

#[cfg(test)]
mod tests {
    use onvif_link::StreamAccess;

    use super::*;

    #[test]
    fn a_file_has_the_camera_its_login_and_the_hooks() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("password");
        std::fs::write(&file, "hunter2\n").expect("a file");
        let camera = |address: &str| {
            let (user, file) = (Some("me".to_owned()), Some(file.clone()));
            let access = StreamAccess::new(address, &["rtsp", "http"], user, file);
            WatchedCamera::Stream(access.expect("an access").read().expect("a password"))
        };
        let doors = Doors { control: 1, pictures: 2, user: "althing", password: "p" };
        let settings = [("threshold".to_owned(), "900".to_owned())];
        let written = text(&camera("rtsp://cam/1"), &doors, &settings).expect("a text");
        for line in [
            "netcam_url rtsp://cam/1",
            "netcam_userpass me:hunter2",
            "on_event_start echo start 1<>\"$ALTHING_MOTION_EVENTS\"",
            "webcontrol_localhost on",
            "stream_authentication althing:p",
            "threshold 900",
        ] {
            assert!(written.lines().any(|written| written == line), "{line} is not in {written}");
        }
        std::fs::write(&file, "a@b\non_event_start evil").expect("a file");
        let problem = text(&camera("http://cam/1"), &doors, &[]).expect_err("a second line");
        assert!(problem.contains("no password with a control character"), "{problem}");
        let written = text(&camera("rtsp://cam/1"), &doors, &[]).expect("a text");
        let line = "netcam_userpass me:a%40b%0Aon_event_start%20evil";
        assert!(written.lines().any(|written| written == line), "{written}");
    }

    #[test]
    fn options_that_run_programs_or_have_two_lines_are_refused() {
        for (name, value, expected) in [
            ("on_event_start", "evil", "cannot be set here"),
            ("target_dir", "/", "cannot be set here"),
            ("threshold", "1\non_event_start evil", "no control character"),
            ("threshold", &"1".repeat(500), "at most 256 bytes"),
        ] {
            let problem = check_option(name, value).expect_err(name);
            assert!(problem.contains(expected), "{problem}");
        }
        check_option("threshold", "900").expect("it is possible");
    }
}
