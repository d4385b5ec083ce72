//! Place of a field within a message, for errors: `pose.position.x`, `status_list[3].status`.

use std::fmt;

/// Path from the message to a field, as a linked list on the stack. A path is written as text only
/// in an error.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FieldPath<'a> {
    parent: Option<&'a FieldPath<'a>>,
    step: PathStep<'a>,
    depth: usize,
}

#[derive(Clone, Copy, Debug)]
enum PathStep<'a> {
    Message,
    Field(&'a str),
    Index(usize),
}

impl FieldPath<'_> {
    /// The path to the message itself.
    pub(crate) const MESSAGE: FieldPath<'static> =
        FieldPath { parent: None, step: PathStep::Message, depth: 0 };

    /// Returns the path to the field `name` of the structure at this path.
    pub(crate) fn field<'a>(&'a self, name: &'a str) -> FieldPath<'a> {
        FieldPath { parent: Some(self), step: PathStep::Field(name), depth: self.depth + 1 }
    }

    /// Returns the path to the element `index` of the array or sequence at this path.
    pub(crate) fn index(&self, index: usize) -> FieldPath<'_> {
        FieldPath { parent: Some(self), step: PathStep::Index(index), depth: self.depth }
    }

    /// Returns the number of fields on the path.
    pub(crate) fn depth(&self) -> usize {
        self.depth
    }
}

impl fmt::Display for FieldPath<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(parent) = self.parent else { return formatter.write_str("the message") };
        let is_first = matches!(parent.step, PathStep::Message);
        if !is_first {
            parent.fmt(formatter)?;
        }
        match self.step {
            PathStep::Message => Ok(()),
            PathStep::Field(name) if is_first => formatter.write_str(name),
            PathStep::Field(name) => write!(formatter, ".{name}"),
            PathStep::Index(index) => write!(formatter, "[{index}]"),
        }
    }
}
