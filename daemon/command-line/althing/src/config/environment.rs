//! The environment as a layer of the configuration: each variable `ALTHING_TABLE__KEY=value` sets a
//! key.
//!
//! The name of a variable is `ALTHING_` and the path of the key in upper case, with `__` between
//! the parts of the path and `_` for `-`. So `ALTHING_ECOSYSTEM__MODE=centralized` is `mode =
//! "centralized"` in `[ecosystem]`; further examples are `ALTHING_TIMING__HEARTBEAT_PERIOD=2s` and
//! `ALTHING_ZENOH__CONNECT__ENDPOINTS='["tcp/pi:7447"]'`. Values other than texts are written as in
//! TOML. Agents cannot be set by variables, only in the file.
//!
//! A variable without `__` in the rest of its name, such as `ALTHING_LOG`, sets no key.

use std::collections::BTreeMap;

use ::config::{Map, Value, ValueKind};
use pddl::{Diagnostic, Span, nearest};
use terminal::report::SourceText;
use toml::Spanned;
use toml::de::DeValue;

use super::layer::{KeyValueSpan, Layer};
use super::reader::{TomlReader, join, to_config_value};
use super::schema::{self, Shape};

const PREFIX: &str = "ALTHING_";
const SEPARATOR: &str = "__";

/// The values of environment variables, by the names of the variables.
pub(crate) type Variables = BTreeMap<String, String>;

/// Returns the environment variables of this process that set keys of the configuration. Bytes that
/// are not UTF-8 are replaced.
pub(crate) fn variables() -> Variables {
    let all = std::env::vars_os().map(|(name, value)| {
        (name.to_string_lossy().into_owned(), value.to_string_lossy().into_owned())
    });
    all.filter(|(name, _)| is_ours(name)).collect()
}

fn is_ours(name: &str) -> bool {
    name.strip_prefix(PREFIX).is_some_and(|path| path.contains(SEPARATOR))
}

/// Reads environment variables against the schema. Returns the values, and diagnostics about
/// invalid variables. The source text of the returned layer lists the variables, one per line.
pub(super) fn read(variables: &Variables) -> (Layer, Vec<Diagnostic>) {
    let mut text = String::new();
    let mut starts = Vec::new();
    for (name, value) in variables.iter().filter(|(name, _)| is_ours(name)) {
        starts.push((text.len(), name, value));
        text += &format!("{name}={value}\n");
    }
    let mut reader = TomlReader::new(SourceText::new("environment", text));
    let mut root = Value::new(None, ValueKind::Table(Map::new()));
    for (start, name, value) in starts {
        if let Some((path, value)) = variable(&mut reader, start, name, value) {
            insert(&mut root, &path, value);
        }
    }
    reader.layer.values = root.into_table().unwrap_or_default();
    (reader.layer, reader.diagnostics)
}

/// Reads one variable. Returns the path of its key and its value. If the schema does not allow
/// them, returns `None` and adds a diagnostic.
fn variable(
    reader: &mut TomlReader,
    start: usize,
    name: &str,
    value: &str,
) -> Option<(Vec<String>, Value)> {
    let name_span = Span::new(start, start + name.len());
    let place = |reader: &mut TomlReader, path: &str| {
        let value_start = start + name.len() + 1;
        let value = Span::new(value_start, value_start + value.len());
        reader.layer.places.insert(path.to_owned(), KeyValueSpan { key: name_span, value });
    };
    let parts: Vec<&str> = name[PREFIX.len()..].split(SEPARATOR).collect();
    let (path, shape, about) = match resolve(&parts) {
        Ok(found) => found,
        Err(help) => {
            let message = format!("`{name}` is no key of an ecosystem file");
            reader.diagnostics.push(Diagnostic::error(name_span, message).with_help(help));
            return None;
        }
    };
    let dotted = path.iter().fold(String::new(), |dotted, part| join(&dotted, part));
    place(reader, &dotted);
    reader.base = start + name.len() + 1;
    let tree = tree(shape, value);
    let value = match shape {
        // A value of these shapes is passed on with any contents.
        Shape::Free | Shape::Any => Some(to_config_value(tree.get_ref())),
        _ => reader.value(&dotted, shape, about, &tree),
    };
    Some((path, value?))
}

/// Parses the value of a variable as TOML. If the schema requires a text, the value needs no
/// quotes.
fn tree<'v>(shape: &Shape, value: &'v str) -> Spanned<DeValue<'v>> {
    let text = || Spanned::new(0..value.len(), DeValue::String(value.into()));
    match shape {
        Shape::Text | Shape::Path | Shape::Choice(_) | Shape::Duration => text(),
        _ => DeValue::parse(value).unwrap_or_else(|_| text()),
    }
}

/// Follows the parts of a variable's name through the schema to a key. Returns the path of the key,
/// the shape of its value, and its description. If there is no such key, the error lists the
/// possible parts.
fn resolve(parts: &[&str]) -> Result<(Vec<String>, &'static Shape, &'static str), String> {
    let mut shape = &schema::FILE;
    let mut about = "";
    let mut path = Vec::new();
    for (index, part) in parts.iter().enumerate() {
        let lower = part.to_lowercase();
        let kebab = lower.replace('_', "-");
        match shape {
            Shape::Table(keys) => {
                let Some(key) = keys.iter().find(|key| key.name == kebab) else {
                    let known: Vec<&str> = keys.iter().map(|key| key.name).collect();
                    return Err(suggestion(&parts[..index], &kebab, &known));
                };
                (shape, about) = (&key.shape, key.about);
                path.push(kebab);
            }
            Shape::Each(element) => {
                shape = element;
                path.push(kebab);
            }
            // Keys of Zenoh contain `_`.
            Shape::Free => path.push(lower),
            Shape::Any => path.push(kebab),
            Shape::List(_) => return Err("agents are set in the ecosystem file only".to_owned()),
            _ => return Err(format!("`{}` has no keys below it", path.join("."))),
        }
    }
    match shape {
        Shape::Table(keys) => {
            let known: Vec<&str> = keys.iter().map(|key| key.name).collect();
            Err(suggestion(parts, "", &known))
        }
        Shape::Each(_) => Err("name a key in it".to_owned()),
        Shape::List(Shape::Table(_)) => Err("agents are set in the ecosystem file only".to_owned()),
        _ => Ok((path, shape, about)),
    }
}

fn suggestion(parts: &[&str], word: &str, known: &[&str]) -> String {
    let variable = |key: &str| {
        let mut parts: Vec<String> = parts.iter().map(|part| (*part).to_owned()).collect();
        parts.push(key.to_uppercase().replace('-', "_"));
        format!("{PREFIX}{}", parts.join(SEPARATOR))
    };
    match nearest(word, known.iter().copied()) {
        Some(key) => format!("did you mean `{}`?", variable(key)),
        None => {
            let all: Vec<String> = known.iter().map(|key| variable(key)).collect();
            format!("known are {}", all.join(", "))
        }
    }
}

/// Inserts a value at a path below `root`, and creates the tables on the way.
fn insert(root: &mut Value, path: &[String], value: Value) {
    let Some((first, rest)) = path.split_first() else {
        *root = value;
        return;
    };
    if !matches!(root.kind, ValueKind::Table(_)) {
        root.kind = ValueKind::Table(Map::new());
    }
    if let ValueKind::Table(table) = &mut root.kind {
        insert(table.entry(first.clone()).or_default(), rest, value);
    }
}
