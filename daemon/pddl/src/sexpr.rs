//! The tree of parentheses, as the grammar reads it.
//!
//! - Built by `balance` from the tokens of `lexer`; read through [`Node`] and [`Items`].
//! - All nodes lie in one vector in the order of the text, so neither building nor dropping a tree
//!   recurses, and skipping a list is one look-up.

use crate::balance::Builder;
use crate::diagnostic::Problems;
use crate::tree::Span;

/// How deep parentheses may nest.
///
/// Whoever recurses over a tree, here or in another crate, has 16 KiB of a 2 MiB stack for each
/// level. The deepest of 224 competition files nests 14 deep.
pub const NESTING_MAX: usize = 128;
const _: () = assert!(NESTING_MAX <= u8::MAX as usize, "`Entry::depth` is a byte");

/// Everything a text holds between its parentheses.
pub(crate) struct Forest<'t> {
    text: &'t str,
    entries: Vec<Entry>,
}

/// A node: list, word, or what could not be kept.
#[derive(Clone, Copy)]
pub(crate) struct Node<'f> {
    forest: &'f Forest<'f>,
    index: u32,
}

/// What a node is.
pub(crate) enum View<'f> {
    List(Items<'f>),
    Symbol(&'f str),
    /// Nested too deep; reported already, so nobody need complain again.
    Damaged,
}

/// The nodes of a list that were not read yet.
#[derive(Clone, Copy)]
pub(crate) struct Items<'f> {
    forest: &'f Forest<'f>,
    next: u32,
    stop: u32,
    /// Where something missing would have to stand: the closing parenthesis, if there is one.
    end: Span,
}

/// A node as it is stored.
#[derive(Clone, Copy)]
pub(crate) struct Entry {
    pub(crate) start: u32,
    pub(crate) end: u32,
    /// The first entry after this node and all it holds.
    pub(crate) next: u32,
    pub(crate) kind: Kind,
    /// How many lists it stands in.
    pub(crate) depth: u8,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    List,
    Symbol,
    Damaged,
}

// === impl Forest ===

impl<'t> Forest<'t> {
    /// Reads all of `text`.
    pub(crate) fn read(text: &'t str, problems: &mut Problems) -> Forest<'t> {
        Forest { text, entries: Builder::new(text, problems).read() }
    }

    /// How many nodes there are.
    pub(crate) fn len(&self) -> usize {
        self.entries.len()
    }

    /// The nodes that stand in no list.
    pub(crate) fn roots(&self) -> Items<'_> {
        Items {
            forest: self,
            next: 0,
            stop: self.entries.len() as u32,
            end: Span::new(self.text.len(), self.text.len()),
        }
    }
}

// === impl Node ===

impl<'f> Node<'f> {
    fn entry(self) -> &'f Entry {
        &self.forest.entries[self.index as usize]
    }

    pub(crate) fn span(self) -> Span {
        let entry = self.entry();
        Span { start: entry.start, end: entry.end }
    }

    pub(crate) fn view(self) -> View<'f> {
        let entry = self.entry();
        match entry.kind {
            Kind::List => View::List(Items {
                forest: self.forest,
                next: self.index + 1,
                stop: entry.next,
                end: self.close(),
            }),
            Kind::Symbol => View::Symbol(self.text()),
            Kind::Damaged => View::Damaged,
        }
    }

    /// Whether no list may stand where this node stands.
    pub(crate) fn is_deepest(self) -> bool {
        usize::from(self.entry().depth) >= NESTING_MAX
    }

    pub(crate) fn symbol(self) -> Option<&'f str> {
        match self.view() {
            View::Symbol(word) => Some(word),
            View::List(_) | View::Damaged => None,
        }
    }

    pub(crate) fn list(self) -> Option<Items<'f>> {
        match self.view() {
            View::List(items) => Some(items),
            View::Symbol(_) | View::Damaged => None,
        }
    }

    /// The word that a list begins with.
    pub(crate) fn head(self) -> Option<&'f str> {
        self.list()?.peek()?.symbol()
    }

    /// Whether two nodes say the same, whatever stands between their words.
    pub(crate) fn says_the_same(self, other: Node<'f>) -> bool {
        let entries = |node: Node<'f>| {
            let all = node.index..node.entry().next;
            all.map(move |index| Node { forest: node.forest, index })
        };
        let is_same = |(one, two): (Node<'f>, Node<'f>)| match (one.symbol(), two.symbol()) {
            (Some(one), Some(two)) => one.eq_ignore_ascii_case(two),
            (None, None) => one.entry().next - one.index == two.entry().next - two.index,
            _ => false,
        };
        entries(self).len() == entries(other).len()
            && entries(self).zip(entries(other)).all(is_same)
    }

    /// The list that begins where this word ends, as functions of other languages are written:
    /// `at(r1, hall)`.
    pub(crate) fn touching_list(self) -> Option<Node<'f>> {
        let Entry { end, next, kind, .. } = *self.entry();
        let list = self.forest.entries.get(next as usize)?;
        let touches = kind == Kind::Symbol && list.kind != Kind::Symbol && list.start == end;
        touches.then_some(Node { forest: self.forest, index: next })
    }

    /// This node and nothing else.
    pub(crate) fn alone(self) -> Items<'f> {
        let Entry { end, next, .. } = *self.entry();
        let end = Span { start: end, end };
        Items { forest: self.forest, next: self.index, stop: next, end }
    }

    /// The closing parenthesis of a list, or the place where its author forgot it.
    fn close(self) -> Span {
        let Entry { start, end, .. } = *self.entry();
        let last = self.forest.text.as_bytes().get((end as usize).wrapping_sub(1));
        let is_closed = end > start + 1 && last == Some(&b')');
        Span { start: end - u32::from(is_closed), end }
    }

    /// The text of the node, parentheses and all.
    pub(crate) fn text(self) -> &'f str {
        self.forest.text.get(self.span().range()).unwrap_or("")
    }
}

// === impl Items ===

impl<'f> Items<'f> {
    pub(crate) fn peek(&self) -> Option<Node<'f>> {
        (self.next < self.stop).then_some(Node { forest: self.forest, index: self.next })
    }

    /// The items before the first that is `last`.
    pub(crate) fn until(self, last: impl Fn(Node<'f>) -> bool) -> Items<'f> {
        let stop = self.into_iter().find(|node| last(*node)).map_or(self.stop, |node| node.index);
        Items { stop, ..self }
    }

    /// The items after `part`, which [`Items::until`] gave.
    pub(crate) fn after(self, part: Items<'f>) -> Items<'f> {
        Items { next: part.stop, ..self }
    }

    /// Where something missing would have to stand: the closing parenthesis.
    pub(crate) fn end(&self) -> Span {
        self.end
    }
}

impl<'f> Iterator for Items<'f> {
    type Item = Node<'f>;

    fn next(&mut self) -> Option<Node<'f>> {
        let node = self.peek()?;
        self.next = node.entry().next;
        Some(node)
    }
}
