//! The files that run in the browser: in this program, or in a folder while they are changed.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use axum::body::Body;
use axum::http::header::{self, HeaderName, HeaderValue};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;

use crate::answer::Refused;

/// The page that all paths of pages get.
pub(crate) const INDEX: &str = "index.html";

/// Level of compression: files are compressed once, at the start.
const COMPRESSION_LEVEL: u8 = 9;

/// Maximum length of a file that is read from a folder, in bytes.
const FILE_BYTES_MAX: u64 = 8 << 20;

/// Makes the table of files of this program.
macro_rules! embedded {
    ($($path:literal),* $(,)?) => {
        &[$(($path, include_bytes!(concat!("../assets/", $path)))),*]
    };
}

/// The files of this program; `assets/files.list` lists them.
const EMBEDDED: &[(&str, &[u8])] = include!("../assets/files.list");

/// A file, ready to be sent.
#[derive(Clone)]
struct Asset {
    plain: Bytes,
    /// The file compressed, if that is shorter.
    gzip: Option<Bytes>,
    /// Hash of the content, in quotes.
    tag: HeaderValue,
    media_type: &'static str,
}

/// The files that run in the browser.
pub(crate) struct Assets {
    files: BTreeMap<&'static str, Asset>,
    /// Folder whose files replace those of this program.
    folder: Option<PathBuf>,
    /// Hash of all files, by which a page notices that it is older than its server.
    version: Arc<str>,
}

impl Assets {
    /// Compresses the files of this program.
    pub(crate) fn new(folder: Option<PathBuf>) -> Assets {
        let mut files = BTreeMap::new();
        let mut all = ring::digest::Context::new(&ring::digest::SHA256);
        for (path, bytes) in EMBEDDED {
            all.update(path.as_bytes());
            all.update(bytes);
            files.insert(*path, Asset::new(path, Bytes::from_static(bytes), true));
        }
        Assets { files, folder, version: hex(all.finish().as_ref()).into() }
    }

    /// Returns the version of the pages.
    pub(crate) fn version(&self) -> &str {
        &self.version
    }

    /// Answers a request for a file.
    pub(crate) async fn answer(&self, path: &str, headers: &HeaderMap) -> Response {
        let found = match &self.folder {
            Some(folder) => from_folder(folder, path).await,
            None => self.files.get(path).cloned(),
        };
        match found {
            Some(asset) => asset.answer(path, headers),
            None => Refused::new(StatusCode::NOT_FOUND, "there is no such file").into_response(),
        }
    }
}

/// Reads a file of a folder, for people that change the pages.
async fn from_folder(folder: &Path, path: &str) -> Option<Asset> {
    let is_inside = |part: Component| matches!(part, Component::Normal(_));
    let relative = Path::new(path);
    if !relative.components().all(is_inside) {
        return None;
    }
    let file = folder.join(relative);
    let name = path.to_owned();
    let read = tokio::task::spawn_blocking(move || {
        let about = std::fs::metadata(&file).ok()?;
        let is_fit = about.is_file() && about.len() <= FILE_BYTES_MAX;
        let bytes = is_fit.then(|| std::fs::read(&file).ok()).flatten()?;
        Some(Asset::new(&name, Bytes::from(bytes), false))
    });
    read.await.ok().flatten()
}

impl Asset {
    fn new(path: &str, plain: Bytes, is_compressed: bool) -> Asset {
        let gzip = is_compressed.then(|| gzip(&plain)).filter(|gzip| gzip.len() < plain.len());
        let digest = hex(ring::digest::digest(&ring::digest::SHA256, &plain).as_ref());
        let no_tag = HeaderValue::from_static("\"\"");
        let tag = HeaderValue::from_str(&format!("\"{digest}\"")).unwrap_or(no_tag);
        Asset { plain, gzip: gzip.map(Bytes::from), tag, media_type: media_type(path) }
    }

    fn answer(self, path: &str, headers: &HeaderMap) -> Response {
        let texts =
            |name: HeaderName| headers.get_all(name).iter().filter_map(|text| text.to_str().ok());
        let tag = self.tag.to_str().unwrap_or_default();
        // A proxy that compresses marks a tag as weak.
        let is_same = |given: &str| given.trim().trim_start_matches("W/") == tag;
        let is_known = texts(header::IF_NONE_MATCH).flat_map(|it| it.split(',')).any(is_same);
        let takes_gzip = texts(header::ACCEPT_ENCODING)
            .flat_map(|text| text.split(','))
            .any(|coding| coding.trim() == "gzip" || coding.trim().starts_with("gzip;q=1"));
        let gzip = self.gzip.filter(|_| takes_gzip);
        let is_gzip = gzip.is_some();
        let mut response = match is_known {
            true => StatusCode::NOT_MODIFIED.into_response(),
            false => Response::new(Body::from(gzip.unwrap_or(self.plain))),
        };
        let answer = response.headers_mut();
        answer.insert(header::ETAG, self.tag);
        answer.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-cache"));
        answer.insert(header::VARY, HeaderValue::from_static("Accept-Encoding"));
        if !is_known {
            answer.insert(header::CONTENT_TYPE, HeaderValue::from_static(self.media_type));
        }
        if is_gzip && !is_known {
            answer.insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
        }
        if path.ends_with("service-worker.js") {
            let everywhere = HeaderValue::from_static("/");
            answer.insert(HeaderName::from_static("service-worker-allowed"), everywhere);
        }
        response
    }
}

fn media_type(path: &str) -> &'static str {
    let end = path.rsplit_once('.').map_or("", |(_, end)| end);
    match end {
        "html" => "text/html; charset=utf-8",
        "js" | "mjs" => "text/javascript; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "json" => "application/json",
        "webmanifest" => "application/manifest+json",
        "svg" => "image/svg+xml",
        "png" => "image/png",
        "ico" => "image/x-icon",
        "woff2" => "font/woff2",
        _ => "text/plain; charset=utf-8",
    }
}

/// Compresses bytes in the format of gzip (RFC 1952).
fn gzip(bytes: &[u8]) -> Vec<u8> {
    // Deflate, no name, no time, best compression, Unix.
    let mut gzip = vec![0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 2, 3];
    gzip.extend(miniz_oxide::deflate::compress_to_vec(bytes, COMPRESSION_LEVEL));
    gzip.extend_from_slice(&crc32(bytes).to_le_bytes());
    // The length modulo 2^32, as the format has it.
    let length = u32::try_from(bytes.len() & 0xffff_ffff).unwrap_or_default();
    gzip.extend_from_slice(&length.to_le_bytes());
    gzip
}

/// Returns the CRC-32 of gzip (ISO 3309).
fn crc32(bytes: &[u8]) -> u32 {
    const POLYNOMIAL: u32 = 0xedb8_8320;
    let mut crc = u32::MAX;
    for byte in bytes {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { (crc >> 1) ^ POLYNOMIAL } else { crc >> 1 };
        }
    }
    !crc
}

fn hex(bytes: &[u8]) -> String {
    // Sixteen bytes tell any two files apart.
    bytes.iter().take(16).map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn files(folder: &Path, under: &str, found: &mut Vec<String>) {
        for entry in std::fs::read_dir(folder).expect("a folder").flatten() {
            let name = format!("{under}{}", entry.file_name().to_string_lossy());
            match entry.path().is_dir() {
                true => files(&entry.path(), &format!("{name}/"), found),
                false => found.push(name),
            }
        }
    }

    #[test]
    fn every_file_is_in_the_program() {
        let mut found = Vec::new();
        files(&Path::new(env!("CARGO_MANIFEST_DIR")).join("assets"), "", &mut found);
        found.retain(|name| name != "files.list");
        found.sort();
        let mut embedded: Vec<_> = EMBEDDED.iter().map(|(path, _)| (*path).to_owned()).collect();
        embedded.sort();
        assert_eq!(embedded, found, "assets/files.list lists every file of assets");
    }

    #[test]
    fn gzip_is_that_of_others() {
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926, "the check value of the standard");
        let bytes = b"abcabcabcabcabcabcabc".repeat(20);
        let gzip = gzip(&bytes);
        let body = &gzip[10..gzip.len() - 8];
        assert_eq!(miniz_oxide::inflate::decompress_to_vec(body).expect("deflate"), bytes);
        assert!(gzip.len() < 60);
    }

    #[tokio::test]
    async fn nothing_outside_of_the_folder_is_read() {
        let folder = tempfile::tempdir().expect("a folder");
        let inside = folder.path().join("in");
        std::fs::create_dir(&inside).expect("created");
        std::fs::write(folder.path().join("secret.txt"), "no").expect("written");
        std::fs::write(inside.join("a.js"), "yes").expect("written");
        assert!(from_folder(&inside, "a.js").await.is_some());
        for path in ["../secret.txt", "/etc/passwd", "b.js", "", ".", "x/../../secret.txt"] {
            assert!(from_folder(&inside, path).await.is_none(), "{path}");
        }
    }
}
