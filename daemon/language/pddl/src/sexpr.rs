//! The tree of parentheses, which is the input of the grammar.
//!
//! - `parentheses` builds the tree from the tokens of `lexer`. Other modules read it through
//!   [`SyntaxNode`] and [`Items`].
//! - All nodes are in one vector in the order of the text, so that building and dropping a tree
//!   need no recursion, and skipping a list is one look-up.

use crate::diagnostic::DiagnosticList;
use crate::parentheses::{ForestBuilder, NESTING_MAX, NodeKind, StoredNode};
use crate::tree::Span;

/// The tree of the words and parentheses of a text.
pub(crate) struct Forest<'t> {
    text: &'t str,
    entries: Vec<StoredNode>,
}

/// A node of the tree: a list, a word, or a damaged part.
#[derive(Clone, Copy)]
pub(crate) struct SyntaxNode<'f> {
    forest: &'f Forest<'f>,
    index: u32,
}

/// Content of a node of the tree.
pub(crate) enum NodeContent<'f> {
    List(Items<'f>),
    Symbol(&'f str),
    /// A part that is nested too deep. It has been reported already, so callers must not report it
    /// again.
    Damaged,
}

/// The items of a list that have not been read yet.
#[derive(Clone, Copy)]
pub(crate) struct Items<'f> {
    forest: &'f Forest<'f>,
    next: u32,
    stop: u32,
    /// Place where a missing item is reported: the closing parenthesis of the list, if there is
    /// one.
    end: Span,
}

// === impl Forest ===

impl<'t> Forest<'t> {
    /// Reads the whole text, and reports mistakes in its parentheses.
    pub(crate) fn read(text: &'t str, problems: &mut DiagnosticList) -> Forest<'t> {
        Forest { text, entries: ForestBuilder::new(text, problems).read() }
    }

    /// Returns the number of nodes in the tree.
    pub(crate) fn len(&self) -> usize {
        self.entries.len()
    }

    /// Returns the places of words with characters that have been reported, in the order of the text.
    pub(crate) fn spoiled(&self) -> Vec<Span> {
        let spoiled = self.entries.iter().filter(|node| node.kind == NodeKind::SpoiledSymbol);
        spoiled.map(|node| Span { start: node.start, end: node.end }).collect()
    }

    /// Returns the nodes that are outside of all lists.
    pub(crate) fn roots(&self) -> Items<'_> {
        Items {
            forest: self,
            next: 0,
            stop: self.entries.len() as u32,
            end: Span::new(self.text.len(), self.text.len()),
        }
    }
}

// === impl SyntaxNode ===

impl<'f> SyntaxNode<'f> {
    fn entry(self) -> &'f StoredNode {
        &self.forest.entries[self.index as usize]
    }

    pub(crate) fn span(self) -> Span {
        let entry = self.entry();
        Span { start: entry.start, end: entry.end }
    }

    pub(crate) fn content(self) -> NodeContent<'f> {
        let entry = self.entry();
        match entry.kind {
            NodeKind::List => NodeContent::List(Items {
                forest: self.forest,
                next: self.index + 1,
                stop: entry.next,
                end: self.close(),
            }),
            NodeKind::Symbol | NodeKind::SpoiledSymbol => NodeContent::Symbol(self.text()),
            NodeKind::Dash => NodeContent::Symbol("-"),
            NodeKind::Damaged => NodeContent::Damaged,
        }
    }

    /// Whether the node is at the maximum depth, so that a list in its place would be nested too
    /// deep.
    pub(crate) fn is_deepest(self) -> bool {
        usize::from(self.entry().depth) >= NESTING_MAX
    }

    pub(crate) fn symbol(self) -> Option<&'f str> {
        match self.content() {
            NodeContent::Symbol(word) => Some(word),
            NodeContent::List(_) | NodeContent::Damaged => None,
        }
    }

    pub(crate) fn list(self) -> Option<Items<'f>> {
        match self.content() {
            NodeContent::List(items) => Some(items),
            NodeContent::Symbol(_) | NodeContent::Damaged => None,
        }
    }

    /// Returns the first word of the list; `None` unless the node is a list that begins with a
    /// word.
    pub(crate) fn head(self) -> Option<&'f str> {
        self.list()?.peek()?.symbol()
    }

    /// Whether two nodes have the same content, ignoring blanks and comments.
    pub(crate) fn says_the_same(self, other: SyntaxNode<'f>) -> bool {
        let entries = |node: SyntaxNode<'f>| {
            let all = node.index..node.entry().next;
            all.map(move |index| SyntaxNode { forest: node.forest, index })
        };
        let is_same =
            |(one, two): (SyntaxNode<'f>, SyntaxNode<'f>)| match (one.symbol(), two.symbol()) {
                (Some(one), Some(two)) => one.eq_ignore_ascii_case(two),
                (None, None) => one.entry().next - one.index == two.entry().next - two.index,
                _ => false,
            };
        entries(self).len() == entries(other).len()
            && entries(self).zip(entries(other)).all(is_same)
    }

    /// Returns the list that begins immediately after this word, like the arguments of a call in
    /// other languages: `at(r1, hall)`. Returns `None` if there is none.
    pub(crate) fn touching_list(self) -> Option<SyntaxNode<'f>> {
        let StoredNode { end, next, kind, .. } = *self.entry();
        let list = self.forest.entries.get(next as usize)?;
        let is_word = |kind: NodeKind| {
            matches!(kind, NodeKind::Symbol | NodeKind::SpoiledSymbol | NodeKind::Dash)
        };
        let touches = is_word(kind) && !is_word(list.kind) && list.start == end;
        touches.then_some(SyntaxNode { forest: self.forest, index: next })
    }

    /// Returns the word that ends where this list begins, as in `at(r1, hall)`; `None` if there is
    /// none.
    pub(crate) fn touched_word(self) -> Option<SyntaxNode<'f>> {
        // A list is stored before its content, so the node before this list is the word.
        let index = self.index.checked_sub(1)?;
        let word = SyntaxNode { forest: self.forest, index };
        word.touching_list().filter(|list| list.index == self.index).map(|_| word)
    }

    /// Returns this node, followed by `rest`, which must be the items after it.
    pub(crate) fn with(self, rest: Items<'f>) -> Items<'f> {
        Items { next: self.index, ..rest }
    }

    /// Returns items that consist of this node only.
    pub(crate) fn alone(self) -> Items<'f> {
        let StoredNode { end, next, .. } = *self.entry();
        let end = Span { start: end, end };
        Items { forest: self.forest, next: self.index, stop: next, end }
    }

    /// Returns the place of the closing parenthesis of the list, or the place where the parenthesis
    /// is missing.
    fn close(self) -> Span {
        let StoredNode { start, end, .. } = *self.entry();
        let last = self.forest.text.as_bytes().get((end as usize).wrapping_sub(1));
        let is_closed = end > start + 1 && last == Some(&b')');
        Span { start: end - u32::from(is_closed), end }
    }

    /// Returns the text of the node. The text of a list includes its parentheses.
    pub(crate) fn text(self) -> &'f str {
        self.forest.text.get(self.span().range()).unwrap_or("")
    }
}

// === impl Items ===

impl<'f> Items<'f> {
    pub(crate) fn peek(&self) -> Option<SyntaxNode<'f>> {
        (self.next < self.stop).then_some(SyntaxNode { forest: self.forest, index: self.next })
    }

    /// Returns the items before the first item for which `last` returns `true`; all items if there
    /// is none.
    pub(crate) fn until(self, last: impl Fn(SyntaxNode<'f>) -> bool) -> Items<'f> {
        let stop = self.into_iter().find(|node| last(*node)).map_or(self.stop, |node| node.index);
        Items { stop, ..self }
    }

    /// Returns the items after those in `part`, which is a result of [`Items::until`].
    pub(crate) fn after(self, part: Items<'f>) -> Items<'f> {
        Items { next: part.stop, ..self }
    }

    /// Returns the place where a missing item is reported: the closing parenthesis of the list.
    pub(crate) fn end(&self) -> Span {
        self.end
    }
}

impl<'f> Iterator for Items<'f> {
    type Item = SyntaxNode<'f>;

    fn next(&mut self) -> Option<SyntaxNode<'f>> {
        let node = self.peek()?;
        self.next = node.entry().next;
        Some(node)
    }
}
