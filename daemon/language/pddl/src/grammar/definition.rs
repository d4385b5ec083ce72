//! Grammar of `(define (KIND NAME) SECTION*)`, the outermost list of every file.

use super::names;
use super::reader::{GrammarReader, Keyword, excerpt};
use super::{domain, model, problem};
use crate::diagnostic::Diagnostic;
use crate::sexpr::{Items, SyntaxNode};
use crate::tree::{Document, Name, Span};

const DEFINE: &str = "(define (domain|problem|agent NAME) SECTION*)";

/// Kind of a PDDL file: domain, problem or action model.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum DocumentKind {
    Domain,
    Problem,
    ActionModel,
}

/// Parses a file of the expected kind, or of any kind if `expected` is `None`:
/// `(define (domain NAME) …) | (define (problem NAME) …) | (define (agent NAME) …)`.
pub(crate) fn document<'f>(
    reader: &mut GrammarReader<'f>,
    roots: Items<'f>,
    expected: Option<DocumentKind>,
) -> Option<Document> {
    single(reader, roots, "definition", |reader, node| definition(reader, node, expected))
}

/// Parses the only node of a text, and reports further nodes.
pub(crate) fn single<'f, T>(
    reader: &mut GrammarReader<'f>,
    mut roots: Items<'f>,
    what: &str,
    production: impl FnOnce(&mut GrammarReader<'f>, SyntaxNode<'f>) -> Option<T>,
) -> Option<T> {
    let Some(mut node) = roots.next() else {
        reader.report(Diagnostic::error(roots.end(), format!("the text holds no {what}")));
        return None;
    };
    // Files from 1998 begin with the name of a Lisp package.
    while let (Some(word), Some(next)) = (node.head(), roots.peek())
        && word.eq_ignore_ascii_case("in-package")
    {
        let message = format!("`{word}` is of Lisp, and passed over");
        reader.report(Diagnostic::warning(node.span(), message));
        roots.next();
        node = next;
    }
    let value = production(reader, node);
    if let Some(more) = roots.next().filter(|more| !reader.is_already_reported(*more)) {
        let message = format!("one {what} is expected, `{}` is more", excerpt(more));
        reader.report(Diagnostic::error(more.span(), message));
    }
    value
}

/// Parses a definition: `(define (KIND NAME) SECTION*)`.
fn definition<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
    expected: Option<DocumentKind>,
) -> Option<Document> {
    let mut items = reader.expect_list(node, "a definition", DEFINE)?;
    let define = reader.expect(&mut items, "`define`", DEFINE)?;
    if !define.symbol().is_some_and(|word| word.eq_ignore_ascii_case("define")) {
        let word = excerpt(define);
        let near = reader.nearest(&word, ["define"]);
        let message = format!("expected `define`, found `{word}`");
        reader.report(Diagnostic::error(define.span(), message).with_rule(DEFINE));
        near?;
    }
    let title = reader.expect(&mut items, "`(domain|problem|agent NAME)`", DEFINE)?;
    let (kind, name) = title_of(reader, title, expected)?;
    if expected.is_some_and(|expected| expected != kind) {
        let message =
            format!("expected {}, found {}", expected.unwrap_or(kind).noun(), kind.noun());
        reader.report(Diagnostic::error(title.span(), message));
    }
    Some(match kind {
        DocumentKind::Domain => Document::Domain(domain::domain(reader, name, items)),
        DocumentKind::Problem => Document::Problem(problem::problem(reader, name, items)),
        DocumentKind::ActionModel => {
            Document::ActionModel(model::action_model(reader, name, items))
        }
    })
}

/// Parses the title of a definition: `(KIND NAME)`. Returns the kind and the name.
fn title_of<'f>(
    reader: &mut GrammarReader<'f>,
    node: SyntaxNode<'f>,
    expected: Option<DocumentKind>,
) -> Option<(DocumentKind, Name)> {
    let mut items = reader.expect_list(node, "`(domain|problem|agent NAME)`", DEFINE)?;
    let word = reader.expect(&mut items, "`domain`, `problem` or `agent`", DEFINE)?;
    let kind = kind(reader, word).or(expected)?;
    let name = reader.expect(&mut items, "name", DEFINE);
    let name = name.and_then(|node| names::name(reader, node, "a name"));
    reader.expect_end(items, "the name", DEFINE);
    // The rest is parsed even without a valid name.
    let name = name.unwrap_or_else(|| Name::placeholder(node.span()));
    Some((kind, name))
}

/// Parses the kind of a file: `domain | problem | agent`. A misspelled word is reported, and the
/// most similar kind is returned.
fn kind<'f>(reader: &mut GrammarReader<'f>, node: SyntaxNode<'f>) -> Option<DocumentKind> {
    const KINDS: &[&str] = &["domain", "problem", "agent"];
    let word = Keyword::of(node.symbol().unwrap_or(""));
    let word = match KINDS.contains(&word.as_str()) {
        true => word.as_str(),
        false => {
            reader.unknown(node, "kind of definition", KINDS);
            reader.nearest(word.as_str(), KINDS.iter().copied())?
        }
    };
    Some(match word {
        "domain" => DocumentKind::Domain,
        "problem" => DocumentKind::Problem,
        _ => DocumentKind::ActionModel,
    })
}

impl DocumentKind {
    fn noun(self) -> &'static str {
        match self {
            DocumentKind::Domain => "a domain",
            DocumentKind::Problem => "a problem",
            DocumentKind::ActionModel => "an action model",
        }
    }
}

/// Iterator over the sections of a definition, in the order of the text.
pub(super) struct Sections<'f> {
    items: Items<'f>,
    /// Keywords of the sections that this kind of file may have.
    known: &'static [&'static str],
    seen: Vec<(&'static str, SyntaxNode<'f>, Span)>,
}

/// A section of a definition: `(:KEYWORD ITEM*)`.
pub(super) struct Section<'f> {
    pub(super) keyword: &'static str,
    pub(super) items: Items<'f>,
    pub(super) span: Span,
}

/// Keywords of sections that may occur any number of times.
const REPEATED: &[&str] = &[":action", ":durative-action", ":derived"];

/// Keywords of sections that are lists. Two sections with the same of these keywords are joined.
const JOINED: &[&str] =
    &[":requirements", ":types", ":constants", ":objects", ":predicates", ":functions", ":init"];

/// Keywords of sections that are valid in PDDL or its extensions but unsupported here. Each pair is
/// the keyword and the name of the feature in a message.
const UNSUPPORTED: &[(&str, &str)] = &[
    (":constraints", "constraints on trajectories (`:constraints`)"),
    (":event", "events (`:event`)"),
    (":process", "processes (`:process`)"),
    (":concurrency-network", "concurrency networks (`:concurrency-network`)"),
    (":concurrency-constraint", "concurrency constraints (`:concurrency-constraint`)"),
    (":axiom", "axioms of PDDL 1.2 (`:axiom`)"),
    (":timeless", "timeless facts (`:timeless`)"),
    (":safety", "safety constraints (`:safety`)"),
    (":method", "methods (`:method`)"),
    (":task", "tasks (`:task`)"),
    (":htn", "task networks (`:htn`)"),
];

/// Pairs of the keyword of a section and the kinds of files that may contain it, as text for a
/// message.
const ELSEWHERE: &[(&str, &str)] = &[
    (":types", "domains and action models"),
    (":constants", "domains"),
    (":predicates", "domains and action models"),
    (":functions", "domains and action models"),
    (":action", "domains and action models"),
    (":durative-action", "domains and action models"),
    (":derived", "domains and action models"),
    (":domain", "problems and action models"),
    (":objects", "problems and action models"),
    (":init", "problems and action models"),
    (":goal", "problems"),
    (":metric", "problems"),
];

impl<'f> Sections<'f> {
    pub(super) fn new(items: Items<'f>, known: &'static [&'static str]) -> Sections<'f> {
        Sections { items, known, seen: Vec::new() }
    }

    /// Returns the place where a missing section is reported: the end of the definition.
    pub(super) fn end(&self) -> Span {
        self.items.end()
    }

    /// Returns the next section; `None` at the end. Nodes that are not sections, sections that are
    /// not expected, and forbidden repetitions are reported and skipped.
    pub(super) fn next(&mut self, reader: &mut GrammarReader<'f>) -> Option<Section<'f>> {
        while let Some(node) = self.items.next() {
            let Some(mut items) = reader.expect_list(node, "a section", "(:KEYWORD …)") else {
                continue;
            };
            let Some(head) = reader.expect(&mut items, "keyword", "(:KEYWORD …)") else {
                continue;
            };
            let word = head.symbol().unwrap_or("");
            let lower = Keyword::of(word);
            match self.known.iter().find(|known| **known == lower.as_str()) {
                Some(keyword) if self.is_read(reader, keyword, node, head.span()) => {
                    return Some(Section { keyword, items, span: node.span() });
                }
                Some(_) => {}
                None => self.report_unknown(reader, head, lower.as_str()),
            }
        }
        None
    }

    /// Whether a section must be parsed. A section with the keyword of an earlier one is parsed
    /// only if sections of this kind are joined and the two have different contents.
    fn is_read(
        &mut self,
        reader: &mut GrammarReader<'f>,
        keyword: &'static str,
        node: SyntaxNode<'f>,
        span: Span,
    ) -> bool {
        if REPEATED.contains(&keyword) {
            return true;
        }
        let Some((_, first, span_of_first)) = self.seen.iter().find(|one| one.0 == keyword) else {
            self.seen.push((keyword, node, span));
            return true;
        };
        let is_joined = JOINED.contains(&keyword);
        let is_same = first.says_the_same(node);
        let message = format!("a second `{keyword}` section");
        let (twice, help) = match (is_joined, is_same) {
            (false, false) => (Diagnostic::error(span, message), "join the two"),
            (_, true) => (Diagnostic::warning(span, message), "it says the same: leave it out"),
            (true, false) => {
                (Diagnostic::warning(span, message), "it is read as if joined to the first")
            }
        };
        reader.report(twice.with_help(help).with_note(*span_of_first, "the first is here"));
        is_joined && !is_same
    }

    fn report_unknown(&self, reader: &mut GrammarReader<'f>, head: SyntaxNode<'f>, lower: &str) {
        let word = excerpt(head);
        if let Some((_, owners)) = ELSEWHERE.iter().find(|(keyword, _)| *keyword == lower) {
            let message = format!("`{word}` belongs to {owners}");
            return reader.report(Diagnostic::error(head.span(), message));
        }
        if matches!(lower, ":length" | ":situation") {
            let message = format!("`{word}` is obsolete and passed over");
            return reader.report(Diagnostic::warning(head.span(), message));
        }
        if let Some((_, feature)) = UNSUPPORTED.iter().find(|(keyword, _)| *keyword == lower) {
            let message = format!("{feature} are not supported");
            return reader.report(Diagnostic::unsupported(head.span(), message));
        }
        let everywhere = ELSEWHERE.iter().map(|(keyword, _)| *keyword);
        let near = reader.nearest(&word, self.known.iter().copied().chain(everywhere));
        let unknown = Diagnostic::error(head.span(), format!("unknown section `{word}`"));
        reader.report(match near {
            Some(_) => unknown.with_suggestion(near),
            None => unknown.with_help(format!("known are {}", self.known.join(" "))),
        });
    }
}
