//! Templates of action models: checking a template against the manifest, and filling it in for an
//! agent.

use std::collections::BTreeMap;

use acl::AgentId;
use minijinja::{Environment, Template, UndefinedBehavior};
use pddl::{Diagnostic, Span};
use serde_json::Value;

use crate::manifest::ConfigKey;

/// Maximum number of steps of the template engine for one template; a template that needs more
/// fails. A model of a thousand actions needs far fewer steps.
const FUEL: u64 = 1_000_000;

fn environment() -> Environment<'static> {
    let mut environment = Environment::new();
    // An unknown key is an error, instead of an empty text.
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    environment.set_fuel(Some(FUEL));
    environment
}

/// Returns the template filled in for an agent with this config: the text of the agent's action
/// model.
///
/// # Errors
///
/// Returns the reason, for a person, if the template is invalid or uses a key that the config does
/// not have.
pub(crate) fn filled_in(
    template: &str,
    name: &str,
    (agent, config): (&AgentId, &Value),
) -> Result<String, String> {
    let values =
        minijinja::context! { agent => agent.as_str(), config => minijinja::value::Serde(config) };
    let rendered = environment().render_named_str(name, template, values);
    rendered.map_err(|error| format!("the template of a model, {error}"))
}

/// Returns the mistakes of a template that do not depend on an agent's config: the template cannot
/// be parsed, or uses names that are not declared for the agents of the package.
pub(crate) fn mistakes(template: &str, keys: &BTreeMap<String, ConfigKey>) -> Vec<Diagnostic> {
    let environment = environment();
    let parsed = match environment.template_from_str(template) {
        Ok(parsed) => parsed,
        Err(error) => {
            let message = format!("the template cannot be read: {error}");
            return vec![Diagnostic::error(line(template, error.line()), message)];
        }
    };
    let mut mistakes: Vec<_> = unknown(&environment, &parsed)
        .into_iter()
        .filter_map(|path| mistake(template, keys, &path))
        .collect();
    mistakes.sort_by_key(|mistake| mistake.span.start);
    mistakes
}

/// Returns the span of a line of the template. `number` is the number of the line, counted from 1.
fn line(template: &str, number: Option<usize>) -> Span {
    let index = number.unwrap_or(1).saturating_sub(1);
    let start = template.split_inclusive('\n').take(index).map(str::len).sum::<usize>();
    let length = template[start..].lines().next().unwrap_or_default().len();
    Span::new(start, start + length)
}

/// Returns the names that the template uses without defining them, such as `config.location`.
fn unknown(environment: &Environment<'_>, template: &Template<'_, '_>) -> Vec<String> {
    let functions: Vec<&str> = environment.globals().map(|(name, _)| name).collect();
    let mut names: Vec<_> = template.undeclared_variables(true).into_iter().collect();
    names.retain(|name| !functions.contains(&name.as_str()));
    names
}

fn mistake(template: &str, keys: &BTreeMap<String, ConfigKey>, path: &str) -> Option<Diagnostic> {
    let (root, rest) = path.split_once('.').map_or((path, None), |(root, rest)| (root, Some(rest)));
    let key = rest.map(|rest| rest.split('.').next().unwrap_or(rest));
    // A hyphen in a template is a minus sign: `config.mounted-on` is `config.mounted` minus `on`.
    let hyphenated = keys.keys().find(|name| match (root, key) {
        ("config", Some(key)) => name.starts_with(&format!("{key}-")),
        _ => name.split('-').skip(1).any(|part| part == root),
    });
    let message = match (root, key) {
        ("agent", _) | ("config", None) => return None,
        ("config", Some(key)) if keys.contains_key(key) => return None,
        // The name is reported once, for its first half.
        (root, _) if root != "config" && hyphenated.is_some() => return None,
        ("config", Some(key)) => format!("the manifest has no [config.{key}]"),
        _ => format!("`{root}` is not known here; known are `agent` and `config`"),
    };
    let start = template.find(path).or_else(|| template.find(root)).unwrap_or_default();
    let mistake = Diagnostic::error(Span::new(start, start + path.len()), message);
    Some(match hyphenated {
        Some(name) => mistake.with_help(format!(
            "a hyphen subtracts in a template: write {{{{ config[\"{name}\"] }}}}"
        )),
        None => mistake,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(template: &str, keys: &[&str]) -> Vec<String> {
        let text = |key: &&str| {
            let key = ((*key).to_owned(), "type = \"text\"\nabout = \"x\"");
            (key.0, toml::from_str(key.1).expect("a key"))
        };
        let mistakes = mistakes(template, &keys.iter().map(text).collect());
        let shown = |mistake: Diagnostic| {
            let at = template.get(mistake.span.range()).unwrap_or_default();
            format!("`{at}`: {}; {}", mistake.message, mistake.help.unwrap_or_default())
        };
        mistakes.into_iter().map(shown).collect()
    }

    #[test]
    fn unknown_names_in_a_template_are_reported_with_their_place() {
        let right = "{{ agent }} {{ config.room }} {{ config[\"mounted-on\"] }}
            {% for i in range(2) %}{{ i }}{% endfor %}";
        assert_eq!(told(right, &["room", "mounted-on"]), Vec::<String>::new());
        assert_eq!(
            told("(on {{ agent }} {{ config.mounted-on }})", &["mounted-on"]),
            ["`config.mounted`: the manifest has no [config.mounted]; a hyphen subtracts in a \
              template: write {{ config[\"mounted-on\"] }}"]
        );
        assert_eq!(
            told("{{ agents }}", &[]),
            ["`agents`: `agents` is not known here; known are `agent` and `config`; "]
        );
        assert_eq!(
            told("{{ config.rom }}", &["room"]),
            ["`config.rom`: the manifest has no [config.rom]; "]
        );
        assert!(told("{{ agent ", &[])[0].contains("cannot be read"));
    }
}
