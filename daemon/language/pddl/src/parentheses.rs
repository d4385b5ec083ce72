//! Parentheses: builds a tree from tokens, without recursion.
//!
//! - The tokens come from `lexer`; `sexpr` gives access to the nodes of the tree.
//! - The nesting is bounded, so that recursion over the tree cannot overflow the stack.
//! - Missing and extra parentheses are repaired where possible, so that one wrong parenthesis gives
//!   one diagnostic and the rest of the file is parsed.

use crate::characters::{self, Lookalike};
use crate::diagnostic::{Diagnostic, DiagnosticList};
use crate::lexer::{self, LexToken};
use crate::tree::Span;

/// Maximum number of levels of nested parentheses. A list that is nested deeper is an error.
///
/// With a stack of 2 MiB, recursion over a tree, here or in another crate, has 16 KiB for each
/// level. The deepest of 224 competition files nests 14 levels deep.
pub const NESTING_MAX: usize = 128;
const _: () = assert!(NESTING_MAX <= u8::MAX as usize, "`StoredNode::depth` is a byte");

/// Words that begin a section of a `(define …)`, and occur in no other place.
const SECTIONS: &[&str] = &[
    ":domain",
    ":requirements",
    ":types",
    ":constants",
    ":predicates",
    ":functions",
    ":derived",
    ":action",
    ":durative-action",
    ":objects",
    ":init",
    ":goal",
    ":metric",
];

/// Words that begin a part of an action, and occur in no other place.
const PARTS: &[&str] = &[":parameters", ":precondition", ":condition", ":duration", ":effect"];

/// A node of the tree in its stored form.
#[derive(Clone, Copy)]
pub(crate) struct StoredNode {
    pub(crate) start: u32,
    pub(crate) end: u32,
    /// Index of the first node after this node and its content.
    pub(crate) next: u32,
    pub(crate) kind: NodeKind,
    /// Number of lists that enclose the node.
    pub(crate) depth: u8,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum NodeKind {
    List,
    Symbol,
    /// A word that looks like `-`, and is read as such. It has been reported already.
    Dash,
    /// A word with a character that has been reported already.
    SpoiledSymbol,
    Damaged,
}

/// Builds the tree of the words and parentheses of a text.
pub(crate) struct ForestBuilder<'t, 'd> {
    text: &'t str,
    entries: Vec<StoredNode>,
    /// Lists that are open, the outermost first.
    open: Vec<u32>,
    /// Number of open parentheses inside a list that is nested too deep.
    open_skipped: usize,
    /// End of the last token, as a byte offset.
    end: usize,
    /// Whether the last token was a word.
    after_word: bool,
    /// Whether the last token was a `)` without an open list.
    after_stray: bool,
    /// Place of a `)` without an open list that no other token has followed so far; `None` if there
    /// is none.
    stray: Option<usize>,
    problems: &'d mut DiagnosticList,
}

impl<'t, 'd> ForestBuilder<'t, 'd> {
    pub(crate) fn new(text: &'t str, problems: &'d mut DiagnosticList) -> ForestBuilder<'t, 'd> {
        ForestBuilder {
            text,
            // Competition files have one token for five to eight bytes.
            entries: Vec::with_capacity(text.len() / 6),
            open: Vec::new(),
            open_skipped: 0,
            end: 0,
            after_word: false,
            after_stray: false,
            stray: None,
            problems,
        }
    }

    /// Reads the whole text. Returns the nodes in the order of the text.
    pub(crate) fn read(mut self) -> Vec<StoredNode> {
        if u32::try_from(self.text.len()).is_err() {
            let message = "the text is longer than 4 GiB";
            self.problems.push(Diagnostic::error(Span::default(), message));
            return Vec::new();
        }
        let mut rest = self.text.strip_prefix('\u{feff}').unwrap_or(self.text).as_bytes();
        while let Ok((left, token)) = lexer::token(rest) {
            rest = left;
            let before = self.end;
            self.end = self.text.len() - left.len();
            if let Some(comment) = self.foreign_comment(token) {
                // The comment may end within the word that begins it: `/* old */new`.
                rest = self.text.as_bytes().get(comment..).unwrap_or_default();
                self.end = comment;
                continue;
            }
            match token {
                LexToken::Symbol(length)
                    if !self.text.as_bytes()[self.end - length..self.end].is_ascii() =>
                {
                    self.take_foreign(length, before);
                }
                _ => self.take(token, before),
            }
        }
        self.finish();
        self.entries
    }

    /// Reports a comment in the style of another language, if this word begins one. Returns the end
    /// of the comment; `None` if there is no comment.
    fn foreign_comment(&mut self, token: LexToken) -> Option<usize> {
        let LexToken::Symbol(length) = token else { return None };
        let start = self.end - length;
        let word = &self.text.as_bytes()[start..self.end];
        let mark = match word {
            // `#t` is the time in a continuous effect.
            [b'#', b't' | b'T'] => return None,
            [b'#', ..] => 1,
            [b'/', b'/' | b'*', ..] => 2,
            _ => return None,
        };
        let is_block = word.starts_with(b"/*");
        let rest = &self.text[start..];
        let length = match is_block {
            // The comment `/*/` is still open.
            true => rest[2..].find("*/").map_or(rest.len(), |end| end + 4),
            false => rest.find(['\n', '\r']).unwrap_or(rest.len()),
        };
        let mark = &rest[..mark];
        self.problems.push(
            Diagnostic::error(
                Span::new(start, start + mark.len()),
                format!("`{mark}` begins no comment in PDDL"),
            )
            .with_help("begin each line of a comment with `;`"),
        );
        Some(start + length)
    }

    /// Adds a word with characters beyond ASCII to the tree. Characters that PDDL does not know are
    /// reported. Those that look like spaces split the word, and those at its ends are left out.
    fn take_foreign(&mut self, length: usize, before: usize) {
        let (start, end) = (self.end - length, self.end);
        let text = self.text;
        let word = &text[start..end];
        let mut found = Vec::new();
        let mut last = None;
        let mut rest = word.char_indices().peekable();
        while let Some((offset, character)) = rest.next() {
            let after = rest.peek().map(|(_, after)| *after);
            if let Some((kind, name)) = characters::lookalike(last, character, after) {
                let offset = start + offset;
                self.problems.push(characters::mistake(offset, character, kind, name));
                found.push((offset, character.len_utf8(), kind));
            }
            last = Some(character);
        }
        if found.is_empty() {
            return self.take(LexToken::Symbol(length), before);
        }
        let mut from = start;
        let spaces = found.iter().filter(|(.., kind)| *kind == Lookalike::Space);
        for (space, width) in spaces.map(|(at, width, _)| (*at, *width)).chain([(end, 0)]) {
            self.take_piece(from, space, &found, before);
            from = space + width;
        }
        self.end = end;
        self.after_word = false;
    }

    /// Adds the word between two offsets, which has no spaces, to the tree. `found` are the
    /// characters in the text that have been reported: their offsets, lengths and kinds.
    fn take_piece(
        &mut self,
        mut start: usize,
        mut end: usize,
        found: &[(usize, usize, Lookalike)],
        before: usize,
    ) {
        let is_left_out = |kind: Lookalike| matches!(kind, Lookalike::Invisible | Lookalike::Quote);
        let within = found.iter().filter(|(at, ..)| (start..end).contains(at));
        let mut within: Vec<_> = within.copied().collect();
        while let Some((at, width, _)) = within.first().filter(|one| is_left_out(one.2))
            && *at == start
        {
            start += width;
            within.remove(0);
        }
        while let Some((at, width, _)) = within.last().filter(|one| is_left_out(one.2))
            && at + width == end
        {
            end = *at;
            within.pop();
        }
        if start >= end {
            return;
        }
        self.end = end;
        match within.as_slice() {
            [] => self.take(LexToken::Symbol(end - start), before),
            _ if self.open_skipped > 0 => {}
            [(_, width, Lookalike::Dash)] if *width == end - start => {
                self.take_spoiled(start, NodeKind::Dash);
            }
            _ => self.take_spoiled(start, NodeKind::SpoiledSymbol),
        }
    }

    fn take_spoiled(&mut self, start: usize, kind: NodeKind) {
        self.report_stray();
        self.after_stray = false;
        self.after_word = true;
        self.push(start, kind);
    }

    /// Adds a token to the tree; `before` is the end of the previous token.
    fn take(&mut self, token: LexToken, before: usize) {
        let touches_word = self.after_word
            && matches!(token, LexToken::Symbol(length) if self.end - length == before);
        self.after_word = matches!(token, LexToken::Symbol(_));
        if let LexToken::Open | LexToken::Symbol(_) = token {
            self.report_stray();
        }
        match token {
            LexToken::Symbol(length) if touches_word && self.open_skipped == 0 => {
                self.report_touching(self.end - length);
                self.symbol(length);
            }
            LexToken::Open if self.open_skipped > 0 => self.open_skipped += 1,
            LexToken::Open => self.open(),
            LexToken::Close if self.open_skipped > 0 => self.close_skipped(),
            LexToken::Close => self.close(),
            LexToken::Symbol(_) if self.open_skipped > 0 => {}
            LexToken::Symbol(length) => self.symbol(length),
        }
    }

    fn push(&mut self, start: usize, kind: NodeKind) {
        let Span { start, end } = Span::new(start, self.end);
        let next = self.entries.len() as u32 + 1;
        let depth = u8::try_from(self.open.len()).unwrap_or(u8::MAX);
        self.entries.push(StoredNode { start, end, next, kind, depth });
    }

    fn open(&mut self) {
        self.after_stray = false;
        if self.open.len() < NESTING_MAX {
            self.push(self.end - 1, NodeKind::List);
            self.open.push(self.entries.len() as u32 - 1);
            return;
        }
        self.open_skipped = 1;
        self.push(self.end - 1, NodeKind::Damaged);
        self.problems.push(too_deep(Span::new(self.end - 1, self.end)));
    }

    fn close(&mut self) {
        if let Some(index) = self.open.pop() {
            self.end_list(index, self.entries.len() as u32, self.end);
        } else if !self.after_stray {
            self.after_stray = true;
            self.stray = Some(self.end - 1);
        }
    }

    /// Reports a stored `)` that closes no list, if there is one. Called when another token
    /// follows, because only then is it an error.
    fn report_stray(&mut self) {
        if let Some(start) = self.stray.take() {
            self.problems.push(
                Diagnostic::error(Span::new(start, start + 1), "`)` closes nothing")
                    .with_help("remove it, or add the `(` that it belongs to"),
            );
        }
    }

    fn report_touching(&mut self, start: usize) {
        let variable = &self.text[start..self.end];
        let touching = Diagnostic::warning(
            Span::new(start, self.end),
            format!("`{variable}` touches the word before it"),
        );
        self.problems.push(touching.with_help("write a space between them"));
    }

    fn close_skipped(&mut self) {
        self.open_skipped -= 1;
        if let (0, Some(damaged)) = (self.open_skipped, self.entries.last_mut()) {
            damaged.end = Span::new(0, self.end).end;
        }
    }

    fn symbol(&mut self, length: usize) {
        self.after_stray = false;
        let start = self.end - length;
        if self.text.as_bytes()[start] == b':' {
            self.repair_before_part(start);
            self.repair_before_section(start);
        }
        self.push(start, NodeKind::Symbol);
    }

    fn end_list(&mut self, index: u32, next: u32, end: usize) {
        let entry = &mut self.entries[index as usize];
        entry.next = next;
        entry.end = Span::new(0, end).end;
    }

    /// Repairs parentheses before a section, which occurs only directly in a `(define …)`. If the
    /// section begins deeper, a closing parenthesis is missing before it. If it begins outside,
    /// there is a closing parenthesis too many.
    fn repair_before_section(&mut self, start: usize) {
        let word = &self.text[start..self.end];
        let heads_a_list = self.open.last().is_some_and(|i| *i as usize + 1 == self.entries.len());
        let is_in_place = self.open.len() == 2;
        if is_in_place
            || !heads_a_list
            || !SECTIONS.iter().any(|known| known.eq_ignore_ascii_case(word))
        {
            return;
        }
        let list = self.entries.len() - 1;
        let section = Span::new(self.entries[list].start as usize, self.end);
        if self.open.len() > 2 && self.is_define(self.open[0]) {
            let unclosed: Vec<u32> = self.open.drain(1..self.open.len() - 1).collect();
            self.close_before(&unclosed, list as u32, section, &format!("({word}"));
        } else if self.open.len() == 1 {
            self.reopen_before(section, word);
        }
    }

    /// Repairs parentheses before a part of an action. Such a part occurs only directly in an
    /// action. If it begins deeper, a closing parenthesis is missing before it.
    fn repair_before_part(&mut self, start: usize) {
        let word = &self.text[start..self.end];
        let is_part = PARTS.iter().any(|known| known.eq_ignore_ascii_case(word));
        let in_action = self.open.len() > 2
            && self.is_define(self.open[0])
            && (self.has_head(self.open[1], ":action")
                || self.has_head(self.open[1], ":durative-action"));
        if is_part && in_action {
            let unclosed: Vec<u32> = self.open.drain(2..).collect();
            let part = Span::new(start, self.end);
            self.close_before(&unclosed, self.entries.len() as u32, part, word);
        }
    }

    /// Closes the lists `unclosed` before the entry `next` at `place`, which cannot be inside these
    /// lists.
    fn close_before(&mut self, unclosed: &[u32], next: u32, place: Span, word: &str) {
        let end = self.text[..place.start as usize].trim_end().len();
        let opener = unclosed.first().map_or(0, |index| self.entries[*index as usize].start);
        for index in unclosed {
            self.end_list(*index, next, end);
        }
        let missing = ")".repeat(unclosed.len());
        self.problems.push(
            Diagnostic::error(Span { start: opener, end: opener + 1 }, "unclosed `(`")
                .with_label("opened here")
                .with_help(format!("add `{missing}` before `{word}`"))
                .with_note(place, format!("`{word}` begins while it is still open")),
        );
    }

    fn reopen_before(&mut self, section: Span, word: &str) {
        let index = self.open[0];
        let Some(define) = self.last_root_before(index).filter(|root| self.is_define(*root)) else {
            return;
        };
        let end = self.entries[define as usize].end as usize;
        self.open.insert(0, define);
        self.problems.push(
            Diagnostic::error(Span::new(end - 1, end), "this `)` closes `(define` too early")
                .with_help("remove it")
                .with_note(section, format!("`({word}` stands outside of `(define`")),
        );
    }

    fn last_root_before(&self, index: u32) -> Option<u32> {
        // The entry before a root is the end of the previous root. Only a `(define` can be that
        // root; the grammar reports a `(define` that is followed by anything else.
        let first = self.entries.first()?;
        (index > 0 && first.next == index).then_some(0)
    }

    fn is_define(&self, index: u32) -> bool {
        self.has_head(index, "define")
    }

    fn has_head(&self, index: u32, word: &str) -> bool {
        let Some(head) = self.entries.get(index as usize + 1) else { return false };
        let found = &self.text[head.start as usize..head.end as usize];
        head.kind == NodeKind::Symbol && found.eq_ignore_ascii_case(word)
    }

    fn finish(&mut self) {
        if let Some(start) = self.stray.take() {
            // The text before it is complete, so an extra parenthesis at the end is harmless.
            let place = Span::new(start, start + 1);
            let extra = match self.entries.is_empty() {
                true => Diagnostic::error(place, "`)` closes nothing"),
                false => Diagnostic::warning(place, "`)` after the end closes nothing"),
            };
            self.problems.push(extra.with_help("remove it"));
        }
        let count = self.open.len() + self.open_skipped;
        if let Some(damaged) = self.entries.last_mut().filter(|_| self.open_skipped > 0) {
            damaged.end = Span::new(0, self.end).end;
        }
        let Some(innermost) = self.open.last() else { return };
        let start = self.entries[*innermost as usize].start as usize;
        let mut diagnostic = Diagnostic::error(Span::new(start, start + 1), "unclosed `(`")
            .with_label("opened here");
        diagnostic.help = Some(match count {
            1 => "add `)` at the end".to_owned(),
            _ => format!("{count} are open at the end of the text"),
        });
        if let [outermost, _, ..] = self.open[..] {
            let start = self.entries[outermost as usize].start as usize;
            diagnostic = diagnostic.with_note(Span::new(start, start + 1), "the outermost is here");
        }
        self.problems.push(diagnostic);
        while let Some(index) = self.open.pop() {
            self.end_list(index, self.entries.len() as u32, self.end);
        }
    }
}

/// Returns the error for the node at `place`, which is nested deeper than allowed.
pub(crate) fn too_deep(place: Span) -> Diagnostic {
    let message = format!("parentheses nested more than {NESTING_MAX} deep are not supported");
    Diagnostic::unsupported(place, message)
        .with_help("split the condition, for example with a derived predicate")
}
