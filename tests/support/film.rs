//! Films and cameras for tests: a film that `ffmpeg` makes, and a camera with a video over RTSP.

use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};

/// Python of the system, which Debian's GStreamer belongs to.
const PYTHON: &str = "/usr/bin/python3";

/// Returns the programs of `needs` that this machine does not have.
pub(crate) fn missing(needs: &[&str]) -> Vec<String> {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let is_there =
        |name: &str| std::env::split_paths(&folders).any(|folder| folder.join(name).is_file());
    needs.iter().filter(|name| !is_there(name)).map(|name| (*name).to_owned()).collect()
}

/// Makes a film of ten seconds: a gray wall, and a white square that crosses it from the third to
/// the sixth second.
pub(crate) fn crossing(folder: &Path) -> PathBuf {
    let film = folder.join("crossing.mp4");
    let wall = "color=gray:size=320x240:rate=10:duration=10";
    let square = "color=white:size=60x60:rate=10:duration=10";
    let cross = "[0][1]overlay=x='if(between(t,3,6),(t-3)*80,-100)':y=90";
    let made = Command::new("ffmpeg")
        .args(["-nostdin", "-loglevel", "error", "-f", "lavfi", "-i", wall])
        .args(["-f", "lavfi", "-i", square, "-filter_complex", cross, "-pix_fmt", "yuv420p"])
        .arg(&film)
        .status();
    assert!(made.expect("ffmpeg runs").success(), "the film is made");
    film
}

/// Returns the processes whose command lines contain `text`, each with its number.
pub(crate) fn processes_with(text: &str) -> Vec<(String, String)> {
    let processes = std::fs::read_dir("/proc").expect("processes").flatten();
    let lines = processes.filter_map(|process| {
        let line = std::fs::read(process.path().join("cmdline")).ok()?;
        let number = process.file_name().into_string().ok()?;
        Some((number, String::from_utf8_lossy(&line).replace('\0', " ")))
    });
    lines.filter(|(_, line)| line.contains(text)).collect()
}

/// Kills the processes whose command lines contain `text`, which only those of this test do.
pub(crate) fn kill_with(text: &str) {
    let processes = processes_with(text);
    assert!(!processes.is_empty(), "{text} runs");
    for (number, _) in processes {
        let killed = Command::new("kill").args(["-KILL", &number]).status();
        assert!(killed.expect("kill runs").success());
    }
}

/// A camera with a video over RTSP. It is killed on drop.
pub(crate) struct RtspCamera {
    server: Child,
    /// The server ends when its input does.
    _input: ChildStdin,
    pub(crate) port: u16,
}

impl RtspCamera {
    /// Starts a camera, with a user and a password if some are given. Returns what this machine
    /// lacks if it cannot be started.
    pub(crate) fn start(login: Option<(&str, &str)>) -> Result<RtspCamera, String> {
        let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../tests/support/rtsp_camera.py");
        let mut command = Command::new(PYTHON);
        command.arg(script).args(login.iter().flat_map(|(user, password)| [user, password]));
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut server = command.spawn().map_err(|error| format!("{PYTHON}: {error}"))?;
        let input = server.stdin.take().expect("a pipe");
        let mut port = String::new();
        let output = server.stdout.take().expect("a pipe");
        BufReader::new(output).read_line(&mut port).expect("a line");
        match port.trim().parse() {
            Ok(port) => Ok(RtspCamera { server, _input: input, port }),
            Err(_) => {
                let _ = server.wait();
                Err("it needs GStreamer's RTSP server: apt install python3-gi \
                     gir1.2-gst-rtsp-server-1.0 gstreamer1.0-plugins-base \
                     gstreamer1.0-plugins-good gstreamer1.0-plugins-ugly"
                    .to_owned())
            }
        }
    }

    /// Kills the camera.
    pub(crate) fn kill(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

impl Drop for RtspCamera {
    fn drop(&mut self) {
        self.kill();
    }
}
