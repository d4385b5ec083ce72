//! Trees as text: `Display` of every tree type.
//!
//! - [`layout`] decides where lines break; the other files say what stands between parentheses.
//! - What is printed parses back to an equal tree; names keep their author's spelling.
//! - Files (domains, problems, action models, plans) take several lines and end with a newline.
//!   Everything smaller is one line, fit for a message; `{:#}` breaks it where it is long.

mod layout;

mod words;

mod conditions;

mod actions;

mod definitions;

mod plans;
