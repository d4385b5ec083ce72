//! Templates: texts with placeholders in braces. `{p}` is the object that is bound to the variable
//! `?p`; `{p.x}` is the value `x` of that object in the table `objects` of the config.

use std::collections::BTreeMap;

use actuator::placeholders;
use serde_json::Value;

/// Values of objects, by the name of the object and the name of the value.
pub(crate) type ObjectValues = BTreeMap<String, BTreeMap<String, Value>>;

/// Returns all texts in a value.
pub(crate) fn texts_in(value: &Value) -> Vec<&str> {
    match value {
        Value::String(text) => vec![text],
        Value::Array(elements) => elements.iter().flat_map(texts_in).collect(),
        Value::Object(fields) => fields.values().flat_map(texts_in).collect(),
        Value::Null | Value::Bool(_) | Value::Number(_) => Vec::new(),
    }
}

/// Returns a value whose texts have their placeholders replaced. A text that is one placeholder
/// becomes the value of the placeholder, which may be a number.
///
/// # Errors
///
/// Returns the first error of `value_of`.
pub(crate) fn filled(
    template: &Value,
    value_of: &dyn Fn(&str) -> Result<Value, String>,
) -> Result<Value, String> {
    Ok(match template {
        Value::String(text) => filled_text(text, value_of)?,
        Value::Array(elements) => {
            let elements = elements.iter().map(|element| filled(element, value_of));
            Value::Array(elements.collect::<Result<_, _>>()?)
        }
        Value::Object(fields) => {
            let field = |(name, value): (&String, &Value)| {
                filled(value, value_of).map(|value| (name.clone(), value))
            };
            Value::Object(fields.iter().map(field).collect::<Result<_, _>>()?)
        }
        Value::Null | Value::Bool(_) | Value::Number(_) => template.clone(),
    })
}

fn filled_text(
    text: &str,
    value_of: &dyn Fn(&str) -> Result<Value, String>,
) -> Result<Value, String> {
    let mut filled = text.to_owned();
    for name in placeholders(text) {
        let (value, braced) = (value_of(name)?, format!("{{{name}}}"));
        if text == braced {
            return Ok(value);
        }
        let value = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        filled = filled.replace(&braced, &value);
    }
    Ok(Value::String(filled))
}

/// Returns the value of a placeholder for a call with these arguments.
///
/// # Errors
///
/// Returns an error if an argument or a value of its object is missing. The text completes “failed
/// to …”.
pub(crate) fn argument_value(
    name: &str,
    arguments: &BTreeMap<String, String>,
    objects: &ObjectValues,
) -> Result<Value, String> {
    let (variable, property) = name.split_once('.').map_or((name, None), |(v, p)| (v, Some(p)));
    let object = arguments.get(variable);
    let object =
        object.ok_or_else(|| format!("fill in `{{{name}}}`: there is no `?{variable}`"))?;
    let Some(property) = property else { return Ok(Value::from(object.as_str())) };
    let value = objects.get(object).and_then(|values| values.get(property));
    value.cloned().ok_or_else(|| {
        format!("fill in `{{{name}}}`: write objects.{object} = {{ {property} = … }}")
    })
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn placeholders_are_replaced_by_objects_and_their_values() {
        let arguments = [("p", "cup-1"), ("to", "shelf")].map(|(k, v)| (k.into(), v.into()));
        let shelf = [("x".to_owned(), json!(0.5)), ("label".to_owned(), json!("A"))];
        let objects = [("shelf".to_owned(), shelf.into())].into();
        let value_of = |name: &str| argument_value(name, &arguments.clone().into(), &objects);
        let template = json!({
            "object": "{p}", "at": [{ "x": "{to.x}" }, 2, true],
            "note": "{p} to {to.label} ({to.x}) {\"json\": 1}",
        });
        let expected = json!({
            "object": "cup-1", "at": [{ "x": 0.5 }, 2, true],
            "note": "cup-1 to A (0.5) {\"json\": 1}",
        });
        assert_eq!(filled(&template, &value_of), Ok(expected));
        let missing = filled(&json!("{p.x}"), &value_of);
        assert_eq!(missing, Err("fill in `{p.x}`: write objects.cup-1 = { x = … }".to_owned()));
    }
}
