//! Printing of trees: `Display` of every tree type.
//!
//! - [`layout`] decides where lines break; the other files decide what is printed between parentheses.
//! - Printed text parses back to an equal tree; names keep their author's spelling.
//! - Files (domains, problems, action models, plans) take several lines and end with a newline.
//!   Everything smaller is one line, fit for a message; `{:#}` breaks it if it is long.

mod layout;

mod terms;

mod conditions;

mod actions;

mod definitions;

mod plans;
