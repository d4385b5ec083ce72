//! The pages that the driver `browser` makes: for texts, pictures and films, and the dark page.

use std::path::{Path, PathBuf};
use std::{fs, io};

use crate::content::{Content, ending};

/// Endings of pictures that are shown in a page of their own, as large as the screen.
const PICTURES: &[&str] =
    &["apng", "avif", "bmp", "gif", "ico", "jfif", "jpeg", "jpg", "png", "svg", "webp"];

/// Endings of films.
const FILMS: &[&str] = &["m4v", "mkv", "mov", "mp4", "ogv", "webm"];

/// The beginning of each page. The page shows nothing but its content, not even the pointer.
const HEAD: &str = "<!doctype html><meta charset=utf-8><title></title><style>
html, body { margin: 0; height: 100%; background: #000; color: #fff; overflow: hidden; cursor: none }
img, video { width: 100vw; height: 100vh; object-fit: contain; display: block }
p { margin: 0; height: 100vh; padding: 0 5vw; box-sizing: border-box; display: flex;
    align-items: center; justify-content: center; text-align: center; white-space: pre-wrap;
    overflow-wrap: anywhere; font-family: sans-serif }
</style>";

/// Maximum size of a text, in hundredths of the shorter side of the screen.
const TEXT_SIZE_MAX: f64 = 16.0;

/// Size of a text of one hundred characters, in hundredths of the shorter side of the screen. The
/// area of a text grows with the square of its size, so the size falls with the root of the length.
const TEXT_SIZE_OF_HUNDRED: f64 = 9.0;

/// The kind of page that shows a medium.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PageKind {
    /// A page that this module makes; its address does not change.
    Own,
    /// A page with a film that this module makes; the film has to move.
    Film,
    /// Any other page or document, which may change its own address.
    Foreign,
}

/// Writes the page for a medium into the folder, if it needs one. Returns the address of the page,
/// and its kind. Without a medium the page is dark.
pub(crate) fn page(folder: &Path, content: Option<&Content>) -> io::Result<(String, PageKind)> {
    let (name, body, kind) = match content {
        None => ("dark", String::new(), PageKind::Own),
        Some(Content::Address(address) | Content::Fetched { address, .. }) => {
            return Ok((address.clone(), PageKind::Foreign));
        }
        Some(Content::Text(text)) => ("text", text_body(text), PageKind::Own),
        Some(Content::File { path, .. }) => match ending(path).as_str() {
            kind if PICTURES.contains(&kind) => {
                ("picture", format!("<img src=\"{}\">", file_address(path)), PageKind::Own)
            }
            kind if FILMS.contains(&kind) => {
                let address = file_address(path);
                ("film", format!("<video src=\"{address}\" autoplay loop></video>"), PageKind::Film)
            }
            "pdf" => {
                check_pdf(path)?;
                let address = format!("{}#toolbar=0&navpanes=0&view=Fit", file_address(path));
                return Ok((address, PageKind::Foreign));
            }
            _ => return Ok((file_address(path), PageKind::Foreign)),
        },
    };
    let file: PathBuf = folder.join(format!("{name}.html"));
    fs::write(&file, format!("{HEAD}{body}"))?;
    Ok((file_address(&file), kind))
}

fn text_body(text: &str) -> String {
    let lines = text.lines().count().max(1) as f64;
    let longest = text.lines().map(|line| line.chars().count()).max().unwrap_or(1).max(1) as f64;
    let by_length = TEXT_SIZE_OF_HUNDRED * (100.0 / text.chars().count().max(1) as f64).sqrt();
    // A line of few characters is not broken, and all lines fit.
    let by_lines =
        (100.0 / (lines * 1.4)).min(if longest <= 20.0 { 150.0 / longest } else { 16.0 });
    let size = by_length.min(by_lines).min(TEXT_SIZE_MAX);
    format!("<p style=\"font-size:{size:.1}vmin\">{}</p>", escaped(text))
}

/// Returns an error if a file is no PDF. The browser would show a message of its own in its place,
/// and would not report it.
fn check_pdf(path: &Path) -> io::Result<()> {
    use io::Read as _;
    let mut start = Vec::new();
    fs::File::open(path)?.take(1024).read_to_end(&mut start)?;
    match start.windows(5).any(|part| part == b"%PDF-") {
        true => Ok(()),
        false => Err(io::Error::other(format!("{} is not a PDF", path.display()))),
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Returns the address of a file, beginning with `file://`.
pub(crate) fn file_address(path: &Path) -> String {
    use std::os::unix::ffi::OsStrExt as _;
    let mut address = "file://".to_owned();
    for byte in path.as_os_str().as_bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'/' | b'-' | b'.' | b'_' | b'~' => {
                address.push(char::from(*byte));
            }
            byte => address += &format!("%{byte:02X}"),
        }
    }
    address
}
