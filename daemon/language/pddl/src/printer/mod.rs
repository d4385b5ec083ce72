//! Printing of trees: implements `Display` for every tree type.
//!
//! - [`layout`] decides where lines break; the other files decide the content.
//! - Printed text parses to an equal tree, and names keep the spelling of their author.
//! - Files (domains, problems, action models, plans) have several lines and end with a newline.
//!   Smaller parts are printed on one line, suitable for a message. With `{:#}`, long lines are
//!   broken.

mod layout;

mod terms;

mod conditions;

mod actions;

mod definitions;

mod plans;
