//! Values within the `config` of an entry, by their paths: the keys of tables, and the numbers of
//! tables in a list.

use serde_json::Value;

/// Returns the keys of a table, or the numbers of the tables in a list; nothing for another value.
pub(super) fn parts(value: &Value) -> Vec<String> {
    match value {
        Value::Object(table) => table.keys().cloned().collect(),
        Value::Array(list) if list.iter().all(Value::is_object) => {
            (0..list.len()).map(|number| number.to_string()).collect()
        }
        _ => Vec::new(),
    }
}

/// Returns the value at a key of a table, or at a number in a list.
pub(super) fn part<'v>(value: &'v Value, key: &str) -> Option<&'v Value> {
    match value {
        Value::Array(list) => list.get(key.parse::<usize>().ok()?),
        other => other.get(key),
    }
}

pub(super) fn at<'v>(value: &'v Value, path: &[String]) -> Option<&'v Value> {
    path.iter().try_fold(value, |value, key| part(value, key))
}

pub(super) fn at_mut<'v>(value: &'v mut Value, path: &[String]) -> Option<&'v mut Value> {
    path.iter().try_fold(value, |value, key| match value {
        Value::Array(list) => list.get_mut(key.parse::<usize>().ok()?),
        other => other.get_mut(key.as_str()),
    })
}

/// Removes the value at `path` from `value`, and returns it.
pub(super) fn take(value: &mut Value, path: &[String]) -> Option<Value> {
    let (last, tables) = path.split_last()?;
    match at_mut(value, tables)? {
        Value::Array(list) => {
            let number = last.parse::<usize>().ok().filter(|number| *number < list.len())?;
            Some(list.remove(number))
        }
        other => other.as_object_mut()?.remove(last.as_str()),
    }
}

/// Returns the texts within a value, each with its path.
pub(super) fn texts_within(value: &Value) -> Vec<(Vec<String>, &str)> {
    let mut found = Vec::new();
    let mut open = vec![(Vec::new(), value)];
    while let Some((path, value)) = open.pop() {
        let below = |key: String| -> Vec<String> { path.iter().cloned().chain([key]).collect() };
        match value {
            Value::String(text) => found.push((path, text.as_str())),
            Value::Array(list) => {
                open.extend(list.iter().enumerate().map(|(at, it)| (below(at.to_string()), it)));
            }
            Value::Object(table) => {
                open.extend(table.iter().map(|(key, it)| (below(key.clone()), it)));
            }
            Value::Null | Value::Bool(_) | Value::Number(_) => (),
        }
    }
    found
}

/// Returns the paths of the keys of this name, in all tables within a value.
pub(super) fn keys_called(value: &Value, name: &str) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    let mut open = vec![(Vec::new(), value)];
    while let Some((path, value)) = open.pop() {
        for key in parts(value) {
            let inner: Vec<String> = path.iter().cloned().chain([key.clone()]).collect();
            if key == name && value.is_object() {
                found.push(inner.clone());
            }
            open.extend(part(value, &key).map(|value| (inner, value)));
        }
    }
    found
}
