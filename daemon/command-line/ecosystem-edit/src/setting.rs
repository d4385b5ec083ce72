//! Settings as a person writes them, `key=value`, and values as TOML writes them.

use toml_edit::{Key, Value};

use crate::edit_error::EditError;

const RULE: &str = "write key=value, such as valid-for=10min or presets.door.shows=hall";

/// A key and its value, as both are written in the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SettingText {
    path: Vec<String>,
    value: String,
}

// === impl SettingText ===

impl SettingText {
    /// Reads a setting `key=value`. A key may be a path, such as `presets.door.shows`. A value that
    /// is a number, `true`, `false`, a list, a table or a quoted text in TOML is taken as it is,
    /// and any other value is a text.
    ///
    /// # Errors
    ///
    /// Returns an error if there is no `=`, or no key before it.
    pub fn read(text: &str) -> Result<SettingText, EditError> {
        let failed = || EditError::Setting { text: text.to_owned(), rule: RULE };
        let (key, value) = text.split_once('=').ok_or_else(failed)?;
        let path = Key::parse(key.trim()).map_err(|_| failed())?;
        let value = value.trim();
        if path.is_empty() || value.contains(char::is_control) {
            return Err(failed());
        }
        let value = match value.parse::<Value>() {
            // Dates are texts here: no setting takes a date of TOML.
            Ok(value) if !value.is_datetime() => value.to_string().trim().to_owned(),
            _ => quoted(value),
        };
        Ok(SettingText { path: path.iter().map(|key| key.get().to_owned()).collect(), value })
    }

    /// Returns a setting with a text as its value.
    pub fn text(key: &str, value: &str) -> SettingText {
        SettingText { path: vec![key.to_owned()], value: quoted(value) }
    }

    /// Returns a setting with a text as its value, of a key in a table.
    pub fn text_in(table: &str, key: &str, value: &str) -> SettingText {
        SettingText { path: vec![table.to_owned(), key.to_owned()], value: quoted(value) }
    }

    /// Returns a setting with a number as its value.
    pub fn number(key: &str, value: f64) -> SettingText {
        SettingText { path: vec![key.to_owned()], value: decimal(value) }
    }

    /// Returns a setting with a whole number as its value.
    pub fn integer(key: &str, value: i64) -> SettingText {
        SettingText { path: vec![key.to_owned()], value: value.to_string() }
    }

    /// Returns a setting with the value `true`.
    pub fn flag(key: &str) -> SettingText {
        SettingText { path: vec![key.to_owned()], value: "true".to_owned() }
    }

    /// Returns the path of the key, its parts joined by dots.
    pub fn key(&self) -> String {
        let parts: Vec<_> = self.path.iter().map(|part| key_text(part)).collect();
        parts.join(".")
    }

    /// Returns the value, as TOML.
    pub fn value(&self) -> &str {
        &self.value
    }

    /// Returns the setting as a line of TOML, without the line's end.
    pub fn line(&self) -> String {
        format!("{} = {}", self.key(), self.value)
    }
}

/// Returns an error if a key is given twice.
pub(crate) fn distinct(settings: &[SettingText]) -> Result<(), EditError> {
    for (index, setting) in settings.iter().enumerate() {
        let key = setting.key();
        if settings.iter().take(index).any(|earlier| earlier.key() == key) {
            return Err(EditError::Twice(key));
        }
    }
    Ok(())
}

/// Returns settings as an inline table: `{}`, or `{ a = 1, b = "c" }`.
pub(crate) fn inline_table(settings: &[SettingText]) -> String {
    match settings {
        [] => "{}".to_owned(),
        settings => {
            let lines: Vec<_> = settings.iter().map(SettingText::line).collect();
            format!("{{ {} }}", lines.join(", "))
        }
    }
}

/// Returns a name as a key of TOML, in quotes only if it needs them.
pub(crate) fn key_text(name: &str) -> String {
    Key::new(name).to_string().trim().to_owned()
}

/// Returns a text as a string of TOML.
pub(crate) fn quoted(text: &str) -> String {
    Value::from(text).to_string().trim().to_owned()
}

/// Returns a number with a decimal point, as TOML needs it for a fraction.
pub(crate) fn decimal(number: f64) -> String {
    Value::from(number).to_string().trim().to_owned()
}
