//! Values in what devices say: in JSON, and through the Jinja templates of Home Assistant, with its
//! filters.

use minijinja::{Environment, Error, ErrorKind, Value as Jinja};
use serde_json::Value;

use crate::described::{Reading, Source};

/// What one template may cost.
const FUEL: u64 = 50_000;

impl Source {
    /// What a text says, as text; `None` if it says nothing of it.
    ///
    /// # Errors
    ///
    /// What is wrong with the template, for a person.
    pub(crate) fn read(&self, text: &str) -> Result<Option<String>, String> {
        match &self.reading {
            Reading::Whole => Ok(Some(text.trim().to_owned())),
            Reading::At(keys) => Ok(at(text, keys)),
            Reading::Template(template) => rendered(template, text).map_err(|(_, said)| said),
        }
    }

    /// What is wrong with it, whatever may be said.
    pub(crate) fn problem(&self) -> Option<String> {
        let Reading::Template(template) = &self.reading else { return None };
        let (kind, problem) = rendered(template, "{}").err()?;
        let is_by_itself = matches!(
            kind,
            ErrorKind::SyntaxError
                | ErrorKind::UnknownFilter
                | ErrorKind::UnknownFunction
                | ErrorKind::UnknownTest
                | ErrorKind::UnknownMethod
                | ErrorKind::OutOfFuel
        );
        is_by_itself.then_some(problem)
    }
}

fn at(text: &str, keys: &[String]) -> Option<String> {
    let Ok(json) = serde_json::from_str::<Value>(text) else {
        // Some say in one word what others say in JSON.
        return (keys.len() == 1).then(|| text.trim().to_owned()).filter(|text| !text.is_empty());
    };
    let value = match (&json, keys) {
        (Value::Object(_), keys) => keys.iter().try_fold(&json, |json, key| json.get(key))?,
        (_, [_]) => &json,
        _ => return None,
    };
    match value {
        Value::Null => None,
        Value::String(text) => Some(text.clone()),
        other => Some(other.to_string()),
    }
}

fn rendered(template: &str, text: &str) -> Result<Option<String>, (ErrorKind, String)> {
    let mut environment = Environment::new();
    environment.set_fuel(Some(FUEL));
    environment.add_filter("is_defined", is_defined);
    environment.add_filter("iif", iif);
    environment.add_filter("from_json", from_json);
    let json: Option<Value> = serde_json::from_str(text).ok();
    let values = minijinja::context! { value => text, value_json => minijinja::value::Serde(json) };
    match environment.render_str(template, values) {
        Ok(rendered) => {
            let rendered = rendered.trim();
            let is_said = !matches!(rendered, "" | "None" | "none" | "unknown" | "unavailable");
            Ok(is_said.then(|| rendered.to_owned()))
        }
        // What is not in the text is not said by it.
        Err(error) if error.kind() == ErrorKind::UndefinedError => Ok(None),
        Err(error) => Err((error.kind(), format!("the template `{template}`: {error}"))),
    }
}

/// Home Assistant's: whoever asks for what is not there wants nothing to be said.
fn is_defined(value: Jinja) -> Result<Jinja, Error> {
    if value.is_undefined() {
        return Err(Error::new(ErrorKind::UndefinedError, "it is not there"));
    }
    Ok(value)
}

fn iif(value: Jinja, yes: Option<Jinja>, no: Option<Jinja>) -> Jinja {
    match value.is_true() {
        true => yes.unwrap_or_else(|| Jinja::from(true)),
        false => no.unwrap_or_else(|| Jinja::from(false)),
    }
}

fn from_json(text: String) -> Result<Jinja, Error> {
    let json: Value = serde_json::from_str(&text)
        .map_err(|error| Error::new(ErrorKind::InvalidOperation, error.to_string()))?;
    Ok(Jinja::from(minijinja::value::Serde(json)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(reading: Reading, text: &str) -> Result<Option<String>, String> {
        Source { topic: String::new(), reading }.read(text)
    }

    #[test]
    fn templates_of_home_assistant_are_understood() {
        let text = r#"{"temperature": 21.56, "battery": null, "ENERGY": {"Power": 7}, "1": "x", "on": true}"#;
        for (template, expected) in [
            ("{{ value_json.temperature }}", Some("21.56")),
            ("{{ value_json.temperature | round(1) }}", Some("21.6")),
            ("{{ (value_json.temperature | float * 9 / 5 + 32) | round(1) }}", Some("70.8")),
            ("{{ value_json['ENERGY'].Power }}", Some("7")),
            ("{{ value_json['1'] }}", Some("x")),
            ("{{ value_json.missing | is_defined }}", None),
            ("{{ value_json.missing }}", None),
            ("{{ value_json.missing | default(3) }}", Some("3")),
            ("{{ 'ON' if value_json.on else 'OFF' }}", Some("ON")),
            ("{% if value_json.on == true %}yes{% else %}no{% endif %}", Some("yes")),
            ("{{ value_json.on | iif('a', 'b') }}", Some("a")),
        ] {
            let read = read(Reading::Template(template.to_owned()), text);
            assert_eq!(read.as_ref().map(Option::as_deref), Ok(expected), "{template}");
        }
        let plain = read(Reading::Template("{{ value | float + 1 }}".to_owned()), "20.5");
        assert_eq!(plain, Ok(Some("21.5".to_owned())));
    }

    #[test]
    fn a_template_that_is_wrong_or_never_ends_is_told() {
        for template in [
            "{{ value_json. }}",
            "{% for i in range(100000) %}{{ i }}{% endfor %}",
            "{{ x | nonsense }}",
        ] {
            let reading = Reading::Template(template.to_owned());
            let problem = read(reading.clone(), "{}").expect_err(template);
            assert!(problem.starts_with("the template `"), "{problem}");
            let source = Source { topic: String::new(), reading };
            assert_eq!(source.problem(), Some(problem), "before anything is said");
        }
        let needs = Reading::Template("{{ value_json.temperature | float }}".to_owned());
        assert_eq!(Source { topic: String::new(), reading: needs }.problem(), None);
    }

    #[test]
    fn values_are_found_in_json() {
        let keys = |keys: &[&str]| Reading::At(keys.iter().map(|key| (*key).to_owned()).collect());
        for (reading, text, expected) in [
            (keys(&["temperature"]), r#"{"temperature":27.34}"#, Some("27.34")),
            (keys(&["SI7021", "Temperature"]), r#"{"SI7021":{"Temperature":21.5}}"#, Some("21.5")),
            (keys(&["occupancy"]), r#"{"occupancy":true}"#, Some("true")),
            (keys(&["state"]), "offline", Some("offline")),
            (keys(&["state"]), r#"{"state":"offline"}"#, Some("offline")),
            (keys(&["temperature"]), r#"{"temperature":null}"#, None),
            (keys(&["a", "b"]), "12", None),
            (Reading::Whole, " ON ", Some("ON")),
        ] {
            assert_eq!(read(reading, text), Ok(expected.map(str::to_owned)), "{text}");
        }
    }
}
