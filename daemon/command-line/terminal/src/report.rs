//! Reports: diagnostics about several texts, each diagnostic with its text.
//!
//! [`pddl::Diagnostic`] describes a problem in a text, in all crates; here it is combined with the
//! file of the text. [`crate::render`] draws it.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use pddl::{Diagnostic, Severity, Span};

use crate::visible;

/// Maximum length of a text, in bytes: a gigabyte. A longer text is an error, because spans have 32
/// bits, and an endless device must not fill the memory.
const TEXT_BYTES_MAX: u64 = 1 << 30;

/// A text that is read as input, and its name.
#[derive(Debug)]
pub struct SourceText {
    /// Path of the file as the user gave it, or a description of a text that is not from a file.
    pub name: String,
    /// The whole text of the file.
    pub text: String,
}

/// A diagnostic together with the text that it is about.
#[derive(Clone, Debug)]
pub struct SourcedDiagnostic {
    /// The text that the diagnostic is about; `None` if it is about no text, for example if a file
    /// cannot be read.
    pub source: Option<Arc<SourceText>>,
    /// The diagnostic; its spans are places in the text.
    pub diagnostic: Diagnostic,
}

/// Diagnostics about several texts, in the order in which they were found.
#[derive(Clone, Debug, Default)]
pub struct DiagnosticReport {
    findings: Vec<SourcedDiagnostic>,
}

// === impl SourceText ===

impl SourceText {
    /// Returns a source text that is not from a file. `name` describes the text in diagnostics.
    pub fn new(name: impl Into<String>, text: impl Into<String>) -> Arc<SourceText> {
        Arc::new(SourceText { name: name.into(), text: text.into() })
    }

    /// Reads a file in UTF-8, UTF-16 (with a byte order mark) or Latin-1.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be read, is too long, or is not text. The message
    /// completes “failed to …” and names the file.
    pub fn read(path: &Path) -> Result<Arc<SourceText>, String> {
        let name = visible::line(&path.display().to_string()).into_owned();
        SourceText::read_as(path, &name).map_err(|reason| match nearby(path) {
            Some(meant) if !path.exists() => {
                format!("read `{name}`: {reason}; did you mean `{meant}`?")
            }
            _ => format!("read `{name}`: {reason}"),
        })
    }

    /// Reads a file that is called `name` in diagnostics.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be read, is too long, or is not text. The message is the
    /// reason alone.
    pub fn read_as(path: &Path, name: &str) -> Result<Arc<SourceText>, String> {
        let bytes = read_bytes(path)?;
        if let Some(text) = utf16(&bytes) {
            return Ok(SourceText::new(name, text));
        }
        if is_binary(&bytes) {
            return Err("it is not UTF-8 text".to_owned());
        }
        let text = match String::from_utf8(bytes) {
            Ok(text) => text,
            Err(err) => pddl::text_from_bytes(err.as_bytes()).into_owned(),
        };
        Ok(SourceText::new(name, text))
    }

    /// Returns line and column at which a span begins; both count from 1.
    pub fn line_column(&self, span: Span) -> (usize, usize) {
        pddl::line_column(&self.text, span.start as usize)
    }
}

/// Returns a file in the same folder as `path` that has a similar name, or a file of the same name in
/// a folder beside or above it.
fn nearby(path: &Path) -> Option<String> {
    let wanted = path.file_name()?.to_string_lossy().into_owned();
    let folder = path.parent().unwrap_or(Path::new(""));
    let similar = similar_name(folder, &wanted).map(|name| folder.join(name));
    Some(similar.or_else(|| same_name(folder, &wanted))?.display().to_string())
}

/// Maximum number of folders in which a file of the same name is looked for.
const FOLDERS_MAX: usize = 64;

/// Returns the file called `wanted` in a folder directly below `folder`, or in the folder above it:
/// users are often one folder off.
fn same_name(folder: &Path, wanted: &str) -> Option<PathBuf> {
    let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let mut below: Vec<PathBuf> = std::fs::read_dir(here)
        .ok()
        .into_iter()
        .flatten()
        .flatten()
        .take(FOLDERS_MAX)
        .map(|entry| folder.join(entry.file_name()))
        .filter(|path| path.is_dir())
        .collect();
    // The system lists a folder in any order.
    below.sort();
    below.push(folder.join(".."));
    below.into_iter().map(|folder| folder.join(wanted)).find(|path| path.is_file())
}

/// Returns the file name in a folder that the user probably meant with `wanted`: a similar name
/// with the same extension, or the same name with a similar extension.
pub fn similar_name(folder: &Path, wanted: &str) -> Option<String> {
    let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let entries = std::fs::read_dir(here).ok()?.flatten();
    let mut names: Vec<String> =
        entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    // The system lists a folder in any order.
    names.sort();
    let parts = |name: &str| -> (String, String) {
        let (stem, ending) = name.rsplit_once('.').unwrap_or((name, ""));
        (stem.to_owned(), ending.to_owned())
    };
    let (stem, ending) = parts(wanted);
    let nearest_by = |wanted: &str, part: &dyn Fn(&str) -> Option<String>| {
        let candidates: Vec<_> =
            names.iter().filter_map(|name| Some((part(name)?, name))).collect();
        let near = pddl::nearest(wanted, candidates.iter().map(|(part, _)| part.as_str()))?;
        candidates.iter().find(|(part, _)| part == near).map(|(_, name)| (*name).clone())
    };
    let stems = |name: &str| Some(parts(name)).filter(|each| each.1 == ending).map(|each| each.0);
    let endings = |name: &str| Some(parts(name)).filter(|each| each.0 == stem).map(|each| each.1);
    nearest_by(&stem, &stems).or_else(|| nearest_by(&ending, &endings))
}

/// Decodes a file in UTF-16, as editors of Windows write it. Returns `None` if the file has no byte
/// order mark.
fn utf16(bytes: &[u8]) -> Option<String> {
    let (mark, rest) = bytes.split_at_checked(2)?;
    let unit = match mark {
        [0xff, 0xfe] => u16::from_le_bytes,
        [0xfe, 0xff] => u16::from_be_bytes,
        _ => return None,
    };
    let units = rest.chunks_exact(2).map(|pair| unit([pair[0], pair[1]]));
    Some(char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect())
}

/// Whether a file is binary, judged by its first 8 KiB: a program, a picture, an archive. About one
/// in nine random bytes is a control character that texts do not contain. A text with only one such
/// character is read, and the error is reported at its place.
fn is_binary(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(8 << 10)];
    let controls = head.iter().filter(|byte| matches!(byte, 0..=8 | 14..=31 | 127)).count();
    controls > 1 && controls * 50 > head.len()
}

fn read_bytes(path: &Path) -> Result<Vec<u8>, String> {
    if path.is_dir() {
        return Err("it is a folder; name a file in it".to_owned());
    }
    let file = File::open(path).map_err(|err| reason(&err))?;
    // A hint only: the size of a pipe is not known, and a file may grow meanwhile.
    let size = file.metadata().map_or(0, |about| about.len().min(TEXT_BYTES_MAX));
    let mut bytes = Vec::with_capacity(usize::try_from(size).unwrap_or(0) + 1);
    file.take(TEXT_BYTES_MAX + 1).read_to_end(&mut bytes).map_err(|err| reason(&err))?;
    if bytes.len() as u64 > TEXT_BYTES_MAX {
        return Err(format!("it has more than {} MiB", TEXT_BYTES_MAX >> 20));
    }
    Ok(bytes)
}

/// Describes an error of the system on reading a file. The system's own message is used only where
/// there is no plainer one.
pub fn reason(err: &std::io::Error) -> String {
    match err.kind() {
        std::io::ErrorKind::NotFound => "there is no such file".to_owned(),
        std::io::ErrorKind::PermissionDenied => "you may not read it".to_owned(),
        _ => err.to_string(),
    }
}

/// Describes why a file could not be written.
pub fn reason_of_writing(err: &std::io::Error) -> String {
    match err.kind() {
        std::io::ErrorKind::NotFound => "there is no such folder".to_owned(),
        std::io::ErrorKind::PermissionDenied => "you may not write there".to_owned(),
        std::io::ErrorKind::IsADirectory => "it is a folder".to_owned(),
        std::io::ErrorKind::StorageFull => "the disk is full".to_owned(),
        _ => err.to_string(),
    }
}

// === impl DiagnosticReport ===

impl DiagnosticReport {
    /// Adds diagnostics about one text to the report.
    pub fn add(
        &mut self,
        source: &Arc<SourceText>,
        diagnostics: impl IntoIterator<Item = Diagnostic>,
    ) {
        self.findings.extend(
            diagnostics.into_iter().map(|diagnostic| SourcedDiagnostic {
                source: Some(Arc::clone(source)),
                diagnostic,
            }),
        );
    }

    /// Adds an error that is about no text to the report. `failure` completes the sentence “failed
    /// to …”.
    pub fn add_failure(&mut self, failure: impl std::fmt::Display) {
        let diagnostic = Diagnostic::error(Span::default(), format!("failed to {failure}"));
        self.findings.push(SourcedDiagnostic { source: None, diagnostic });
    }

    /// Adds a diagnostic that is about no text to the report.
    pub fn add_general(&mut self, diagnostic: Diagnostic) {
        self.findings.push(SourcedDiagnostic { source: None, diagnostic });
    }

    /// Adds all diagnostics of another report to this report.
    pub fn extend(&mut self, other: DiagnosticReport) {
        self.findings.extend(other.findings);
    }

    /// Returns the diagnostics of the report.
    pub fn findings(&self) -> &[SourcedDiagnostic] {
        &self.findings
    }

    /// Whether the report has no diagnostics.
    pub fn is_empty(&self) -> bool {
        self.findings.is_empty()
    }

    /// Whether the report has errors.
    pub fn has_errors(&self) -> bool {
        self.count(Severity::Error) > 0
    }

    /// Whether a diagnostic of the report is about a feature that is not supported.
    pub fn is_unsupported(&self) -> bool {
        self.findings.iter().any(|finding| finding.diagnostic.is_unsupported)
    }

    /// Returns the word that states the outcome and the exit code, with which a program rejects its
    /// input because of this report.
    pub fn refusal(&self) -> (&'static str, u8) {
        match self.is_unsupported() {
            true => ("unsupported", crate::exit::UNSUPPORTED),
            false => ("bad-input", crate::exit::BAD_INPUT),
        }
    }

    /// Returns the report without the errors that may only follow from an unsupported feature,
    /// because that feature leaves gaps in the parsed text. If no feature is unsupported, returns
    /// the whole report.
    pub fn refused(mut self) -> DiagnosticReport {
        if self.is_unsupported() {
            self.findings.retain(|finding| {
                finding.diagnostic.is_unsupported || !finding.diagnostic.is_error()
            });
        }
        self
    }

    /// Removes the diagnostics for which `keep` returns `false`.
    pub fn retain(&mut self, keep: impl FnMut(&SourcedDiagnostic) -> bool) {
        self.findings.retain(keep);
    }

    /// Returns the number of diagnostics of one severity in the report.
    pub fn count(&self, severity: Severity) -> usize {
        self.findings.iter().filter(|finding| finding.diagnostic.severity == severity).count()
    }

    /// Sorts the diagnostics by text, and within each text by place. Texts are in the order of
    /// their first diagnostics.
    pub fn sort(&mut self) {
        let mut texts: Vec<String> = Vec::new();
        let rank = |finding: &SourcedDiagnostic| {
            let name = finding.source.as_ref().map_or("", |source| &source.name);
            let known = texts.iter().position(|text| text == name);
            known.unwrap_or_else(|| {
                texts.push(name.to_owned());
                texts.len() - 1
            })
        };
        let ranks: Vec<usize> = self.findings.iter().map(rank).collect();
        let mut ranked: Vec<(usize, SourcedDiagnostic)> =
            ranks.into_iter().zip(std::mem::take(&mut self.findings)).collect();
        ranked.sort_by_key(|(rank, SourcedDiagnostic { diagnostic, .. })| {
            (*rank, diagnostic.span.start, diagnostic.span.end)
        });
        self.findings = ranked.into_iter().map(|(_, finding)| finding).collect();
    }

    /// Removes repeated diagnostics about one place. Such repetitions occur if a file is read
    /// twice.
    pub fn dedup(&mut self) {
        let mut seen = BTreeSet::new();
        self.findings.retain(|SourcedDiagnostic { source, diagnostic }| {
            let file = source.as_ref().map(|source| source.name.clone());
            seen.insert((file, diagnostic.span.start, diagnostic.message.clone()))
        });
    }
}
