//! A display without hardware (Xvfb), its pixels, files to show, and a server of pages.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use tempfile::TempDir;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpListener;

use super::left_out::left_out;
use super::*;

/// Time within which a colour has to appear, on a busy machine.
const PATIENCE: Duration = Duration::from_secs(20);

pub(super) const BLACK: Color = (0, 0, 0);
pub(super) const RED: Color = (255, 0, 0);
pub(super) const BLUE: Color = (0, 0, 255);

pub(super) type Color = (u8, u8, u8);

/// A display of 640 × 480 pixels, and a folder. The server of the display is killed on drop.
pub(super) struct Stage {
    server: Child,
    pub(super) display: String,
    pub(super) folder: TempDir,
}

impl Stage {
    /// Starts a display. Returns `None` and reports the test as left out if a program is missing.
    pub(super) fn set(needs: &[&str]) -> Option<Stage> {
        let needs = needs.iter().chain(&["Xvfb", "xwd"]);
        let paths = std::env::var_os("PATH").unwrap_or_default();
        let is_there = |name: &str| std::env::split_paths(&paths).any(|at| at.join(name).is_file());
        let missing: Vec<_> = needs.copied().filter(|name| !is_there(name)).collect();
        if !missing.is_empty() {
            let missing = missing.join(", ");
            left_out(&format!("it needs {missing}: apt install chromium mpv xvfb x11-apps"));
            return None;
        }
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "640x480x24", "-nolisten", "tcp"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb starts");
        let mut number = String::new();
        let output = server.stdout.take().expect("a pipe");
        BufReader::new(output).read_line(&mut number).expect("it tells its number");
        let folder = tempfile::tempdir().expect("a folder");
        Some(Stage { server, display: format!(":{}", number.trim()), folder })
    }

    /// Returns the colours in the middle and near the four corners of the display.
    pub(super) fn colors(&self) -> Vec<Color> {
        let output = Command::new("xwd")
            .args(["-silent", "-root", "-display", &self.display])
            .output()
            .expect("xwd runs");
        let dump = output.stdout;
        let word = |index: usize| {
            let bytes = dump.get(index * 4..index * 4 + 4).expect("a header");
            u32::from_be_bytes(bytes.try_into().expect("four bytes")) as usize
        };
        // The header of X11's XWDFile.h, and its table of colours of 12 bytes each.
        let (size, bits, line, colors) = (word(0), word(11), word(12), word(19));
        assert_eq!((word(4), word(5), bits, word(7)), (640, 480, 32, 0), "of 32 bits, in order");
        let pixel = |x: usize, y: usize| {
            let at = size + colors * 12 + y * line + x * 4;
            match dump.get(at..at + 3).expect("a pixel") {
                [blue, green, red] => (*red, *green, *blue),
                _ => unreachable!("three bytes"),
            }
        };
        [(320, 240), (3, 3), (636, 3), (3, 476), (636, 476)].map(|(x, y)| pixel(x, y)).to_vec()
    }

    /// Waits until the middle of the display has a colour, apart from what films lose by their
    /// encoding.
    pub(super) async fn shows(&self, color: Color) {
        let is_like = |(red, green, blue): Color| {
            let near = |one: u8, other: u8| one.abs_diff(other) < 16;
            near(red, color.0) && near(green, color.1) && near(blue, color.2)
        };
        let began = std::time::Instant::now();
        while !self.colors().first().copied().is_some_and(is_like) {
            assert!(began.elapsed() < PATIENCE, "{:?} is not {color:?}", self.colors());
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }

    /// Waits until the whole display is dark.
    pub(super) async fn is_dark(&self) {
        let began = std::time::Instant::now();
        while self.colors() != [BLACK; 5] {
            assert!(began.elapsed() < PATIENCE, "{:?} is not dark", self.colors());
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }

    /// Writes a file that a screen can show, and returns its path.
    pub(super) fn file(&self, name: &str, bytes: &[u8]) -> String {
        let path: PathBuf = self.folder.path().join(name);
        fs::write(&path, bytes).expect("a file");
        path.display().to_string()
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// Returns a picture of one colour, as BMP.
pub(super) fn picture((red, green, blue): Color) -> Vec<u8> {
    let (side, pixels) = (64_u32, 64 * 64 * 3_u32);
    let mut bytes = b"BM".to_vec();
    for word in [54 + pixels, 0, 54, 40, side, side, 1 | 24 << 16, 0, pixels, 2835, 2835, 0, 0] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend([blue, green, red].repeat((side * side) as usize));
    bytes
}

/// Returns a film of one colour and two seconds, uncompressed (YUV4MPEG2).
pub(super) fn film(luma: u8, cb: u8, cr: u8) -> Vec<u8> {
    let mut bytes = b"YUV4MPEG2 W64 H64 F10:1 Ip A1:1 C420\n".to_vec();
    for _ in 0..20 {
        bytes.extend(b"FRAME\n");
        bytes.extend([luma].repeat(64 * 64));
        bytes.extend([cb].repeat(32 * 32));
        bytes.extend([cr].repeat(32 * 32));
    }
    bytes
}

/// Encodes a film so that a browser plays it.
pub(super) fn encode(from: &str, to: &Path) {
    let encoded = Command::new("mpv")
        .args(["--no-config", "--no-terminal", "--ovc=libvpx", "--no-audio", from])
        .arg(format!("--o={}", to.display()))
        .status()
        .expect("mpv runs");
    assert!(encoded.success() && to.is_file(), "mpv encodes {from}");
}

/// Returns a PDF with one page, which is filled with blue.
pub(super) fn pdf() -> Vec<u8> {
    let content = "0 0 1 rg 0 0 640 480 re f";
    let objects = [
        "<< /Type /Catalog /Pages 2 0 R >>".to_owned(),
        "<< /Type /Pages /Kids [3 0 R] /Count 1 >>".to_owned(),
        "<< /Type /Page /Parent 2 0 R /MediaBox [0 0 640 480] /Contents 4 0 R >>".to_owned(),
        format!("<< /Length {} >>\nstream\n{content}\nendstream", content.len()),
    ];
    let mut text = "%PDF-1.4\n".to_owned();
    let mut places = String::new();
    for (number, object) in objects.iter().enumerate() {
        places += &format!("{:010} 00000 n \n", text.len());
        text += &format!("{} 0 obj\n{object}\nendobj\n", number + 1);
    }
    let place = text.len();
    let count = objects.len() + 1;
    text += &format!("xref\n0 {count}\n0000000000 65535 f \n{places}");
    text += &format!("trailer << /Size {count} /Root 1 0 R >>\nstartxref\n{place}\n%%EOF\n");
    text.into_bytes()
}

/// Serves pages on a port of this machine, and returns its address: `/red` and `/blue` are pages of
/// one colour, `/alert` is blue behind a dialog, `/onward` goes to `/red` at once, `/logo` is blue
/// with a picture and a film that are missing, `/leaves?ADDRESS` is red and goes to the address
/// after a second, `/hangs` is red and its script never ends. All others are not found.
pub(super) async fn serve() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let address = format!("http://{}", listener.local_addr().expect("an address"));
    tokio::spawn(async move {
        while let Ok((mut stream, _)) = listener.accept().await {
            let mut request = vec![0; 4096];
            let Ok(count) = stream.read(&mut request).await else { continue };
            let request = String::from_utf8_lossy(&request[..count]).into_owned();
            let path = request.split(' ').nth(1).unwrap_or_default();
            let (path, query) = path.split_once('?').unwrap_or((path, ""));
            let page = |color: &str, more: &str| {
                format!("<!doctype html><body style='background:{color}'><script>{more}</script>")
            };
            let (status, body) = match path {
                "/red" => ("200 OK", page("#f00", "")),
                "/blue" => ("200 OK", page("#00f", "")),
                "/logo" => ("200 OK", page("#00f", "") + "<p>Text<img src='/no'><video src='/no'>"),
                "/onward" => ("200 OK", page("#fff", "onload = () => location = '/red'")),
                "/alert" => ("200 OK", page("#00f", "alert('Hello')")),
                "/leaves" => {
                    let script = format!("setTimeout(() => location = '{query}', 1000)");
                    ("200 OK", page("#f00", &script))
                }
                "/hangs" => ("200 OK", page("#f00", "setTimeout(() => { for (;;); }, 1500)")),
                _ => ("404 Not Found", page("#fff", "")),
            };
            let length = body.len();
            let head = format!(
                "HTTP/1.1 {status}\r\nContent-Type: text/html\r\nContent-Length: {length}\r\n\
                 Connection: close\r\n\r\n"
            );
            let _ = stream.write_all(format!("{head}{body}").as_bytes()).await;
        }
    });
    address
}

/// Returns the ids of living processes with `word` in their command lines.
pub(super) fn processes(word: &str) -> Vec<i32> {
    let pids = fs::read_dir("/proc").expect("/proc").flatten();
    let pids = pids.filter_map(|entry| entry.file_name().to_str()?.parse::<i32>().ok());
    let is_it = |pid: &i32| {
        let line = fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        String::from_utf8_lossy(&line).contains(word)
    };
    pids.filter(is_it).collect()
}

/// Waits until no process has `word` in its command line.
pub(super) async fn nothing_is_left(word: &str) {
    let began = std::time::Instant::now();
    while !processes(word).is_empty() {
        assert!(began.elapsed() < PATIENCE, "{:?} are left", processes(word));
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

/// Kills a process, as the kernel does when memory is short.
pub(super) fn kill(pid: i32) {
    let killed = Command::new("kill").args(["-KILL", &pid.to_string()]).status().expect("kill");
    assert!(killed.success());
}
