//! Printing of trees: implements `Display` for every tree type.
//!
//! - [`layout`] decides where lines break; the other files decide what is printed between parentheses.
//! - Printed text parses back to an equal tree; names keep their author's spelling.
//! - Files (domains, problems, action models, plans) take several lines and end with a newline.
//!   Anything smaller is printed on one line, fit for a message; with `{:#}`, long lines are broken.

mod layout;

mod terms;

mod conditions;

mod actions;

mod definitions;

mod plans;
