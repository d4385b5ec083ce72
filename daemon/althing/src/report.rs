//! Mistakes gathered over several texts, each with the text it points into.
//!
//! [`pddl::Diagnostic`] is how all of the house speaks of a mistake in a text; here it meets the
//! file that the text came from. Drawn by [`crate::render`].

use std::collections::BTreeSet;
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use pddl::{Diagnostic, Severity, Span};

/// The largest text that is read: a gigabyte. Spans are 32 bits wide, and a device that never ends
/// must not fill the memory.
const TEXT_BYTES_MAX: u64 = 1 << 30;

/// A text and what it is called.
#[derive(Debug)]
pub(crate) struct Source {
    /// The file as the user named it, or what else the text is.
    pub(crate) name: String,
    /// All of it.
    pub(crate) text: String,
}

/// A mistake and the text it is in, if it is in one.
#[derive(Clone, Debug)]
pub(crate) struct Finding {
    /// The text; none for a file that cannot be read.
    pub(crate) source: Option<Arc<Source>>,
    /// The mistake; its spans are places of the text.
    pub(crate) diagnostic: Diagnostic,
}

/// Mistakes in the order in which they were found.
#[derive(Clone, Debug, Default)]
pub(crate) struct Report {
    findings: Vec<Finding>,
}

// === impl Source ===

impl Source {
    /// A text that is no file.
    pub(crate) fn new(name: impl Into<String>, text: impl Into<String>) -> Arc<Source> {
        Arc::new(Source { name: name.into(), text: text.into() })
    }

    /// Reads a file whatever its encoding.
    ///
    /// The error completes “failed to …” and names the file.
    pub(crate) fn read(path: &Path) -> Result<Arc<Source>, String> {
        let name = path.display().to_string();
        Source::read_as(path, &name).map_err(|reason| format!("read `{name}`: {reason}"))
    }

    /// Reads a file that is to be called `name`. The error is the reason alone.
    pub(crate) fn read_as(path: &Path, name: &str) -> Result<Arc<Source>, String> {
        let bytes = read_bytes(path)?;
        let text = match String::from_utf8(bytes) {
            Ok(text) => text,
            Err(err) => pddl::text_from_bytes(err.as_bytes()).into_owned(),
        };
        Ok(Source::new(name, text))
    }

    /// Line and column of a place, both from 1.
    pub(crate) fn line_column(&self, span: Span) -> (usize, usize) {
        pddl::line_column(&self.text, span.start as usize)
    }
}

fn read_bytes(path: &Path) -> Result<Vec<u8>, String> {
    if path.is_dir() {
        return Err("it is a folder; name a file in it".to_owned());
    }
    let file = File::open(path).map_err(|err| reason(&err))?;
    let mut bytes = Vec::new();
    file.take(TEXT_BYTES_MAX + 1).read_to_end(&mut bytes).map_err(|err| reason(&err))?;
    if bytes.len() as u64 > TEXT_BYTES_MAX {
        return Err(format!("it has more than {} MiB", TEXT_BYTES_MAX >> 20));
    }
    Ok(bytes)
}

/// An error of the system in words, without its number where the words say it all.
pub(crate) fn reason(err: &std::io::Error) -> String {
    match err.kind() {
        std::io::ErrorKind::NotFound => "there is no such file".to_owned(),
        std::io::ErrorKind::PermissionDenied => "you may not read it".to_owned(),
        _ => err.to_string(),
    }
}

// === impl Report ===

impl Report {
    /// Adds mistakes of one text.
    pub(crate) fn add(
        &mut self,
        source: &Arc<Source>,
        diagnostics: impl IntoIterator<Item = Diagnostic>,
    ) {
        self.findings.extend(
            diagnostics
                .into_iter()
                .map(|diagnostic| Finding { source: Some(Arc::clone(source)), diagnostic }),
        );
    }

    /// Adds an error that is in no text. `failure` completes “failed to …”.
    pub(crate) fn add_failure(&mut self, failure: impl std::fmt::Display) {
        let diagnostic = Diagnostic::error(Span::default(), format!("failed to {failure}"));
        self.findings.push(Finding { source: None, diagnostic });
    }

    /// Adds a mistake that is in no text.
    pub(crate) fn add_general(&mut self, diagnostic: Diagnostic) {
        self.findings.push(Finding { source: None, diagnostic });
    }

    /// Adds all of another report.
    pub(crate) fn extend(&mut self, other: Report) {
        self.findings.extend(other.findings);
    }

    /// The mistakes.
    pub(crate) fn findings(&self) -> &[Finding] {
        &self.findings
    }

    /// Whether there is nothing to say.
    pub(crate) fn is_empty(&self) -> bool {
        self.findings.is_empty()
    }

    /// Whether something cannot be used as it is.
    pub(crate) fn has_errors(&self) -> bool {
        self.count(Severity::Error) > 0
    }

    /// How many there are of one severity.
    pub(crate) fn count(&self, severity: Severity) -> usize {
        self.findings.iter().filter(|finding| finding.diagnostic.severity == severity).count()
    }

    /// Orders the mistakes of each text by their places, the texts by when they were first named.
    pub(crate) fn sort(&mut self) {
        let mut texts: Vec<String> = Vec::new();
        let rank = |finding: &Finding| {
            let name = finding.source.as_ref().map_or("", |source| &source.name);
            let known = texts.iter().position(|text| text == name);
            known.unwrap_or_else(|| {
                texts.push(name.to_owned());
                texts.len() - 1
            })
        };
        let ranks: Vec<usize> = self.findings.iter().map(rank).collect();
        let mut ranked: Vec<(usize, Finding)> =
            ranks.into_iter().zip(std::mem::take(&mut self.findings)).collect();
        ranked.sort_by_key(|(rank, Finding { diagnostic, .. })| {
            (*rank, diagnostic.span.start, diagnostic.span.end)
        });
        self.findings = ranked.into_iter().map(|(_, finding)| finding).collect();
    }

    /// Removes what is said twice of one place: a file may be reached on two ways.
    pub(crate) fn dedup(&mut self) {
        let mut seen = BTreeSet::new();
        self.findings.retain(|Finding { source, diagnostic }| {
            let file = source.as_ref().map(|source| source.name.clone());
            seen.insert((file, diagnostic.span.start, diagnostic.message.clone()))
        });
    }
}
