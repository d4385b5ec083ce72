//! Tables in the `config` of agents.

use serde::{Deserialize, Deserializer};
use serde_json::{Map, Value};

/// Reads a table of a `config`. Used by [`config_tables`](crate::config_tables).
///
/// # Errors
///
/// Returns an error if something else than a table is there.
pub fn config_table<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Value, D::Error> {
    Map::deserialize(deserializer).map(Value::Object)
}

/// Implements `Deserialize` for types with `#[serde(remote = "Self")]`, which are tables within a
/// `config`.
///
/// Without it, serde reads such a type from a list too, and takes the elements for the values of the
/// keys in the order of their declaration, which authors do not know.
#[macro_export]
macro_rules! config_tables {
    ($($table:ty),+ $(,)?) => {$(
        impl<'de> ::serde::Deserialize<'de> for $table {
            fn deserialize<D: ::serde::Deserializer<'de>>(
                deserializer: D,
            ) -> ::std::result::Result<Self, D::Error> {
                let table = $crate::config_table(deserializer)?;
                <$table>::deserialize(table).map_err(::serde::de::Error::custom)
            }
        }
    )+};
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(remote = "Self", deny_unknown_fields)]
    struct Battery {
        range: f64,
        #[serde(default)]
        charge: Option<f64>,
    }

    crate::config_tables!(Battery);

    #[test]
    fn a_table_is_no_list() {
        let read = |value: Value| {
            serde_json::from_value::<Battery>(value).map_err(|error| error.to_string())
        };
        assert_eq!(read(json!({ "range": 2.0 })), Ok(Battery { range: 2.0, charge: None }));
        let list = "invalid type: sequence, expected a map";
        assert_eq!(read(json!([2.0, 1.0])), Err(list.to_owned()));
        assert_eq!(read(json!({})), Err("missing field `range`".to_owned()));
        let unknown = read(json!({ "range": 2.0, "size": 1 })).expect_err("an unknown key");
        assert!(unknown.starts_with("unknown field `size`"), "{unknown}");
    }
}
