//! Test that the published JSON Schema of the protocol (docs/protocol.schema.json) agrees with the
//! types of this crate. `UPDATE_EXPECT=1 cargo test -p acl schema` regenerates the schema.

use std::path::Path;

use schemars::{JsonSchema, SchemaGenerator};
use serde_json::{Value, json};

use crate::content::{
    Agreement, Bid, CallForProposals, CancelAction, Choice, Inform, PlanProposal, Question,
    Refusal, Report, Request, Withdrawal,
};
use crate::{Hello, Message, Performative, SCHEMA_VERSION};

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../docs/protocol.schema.json");

fn of<T: JsonSchema>(generator: &mut SchemaGenerator) -> Value {
    generator.subschema_for::<T>().to_value()
}

/// Returns the schemas of the contents of messages with a performative, one for each protocol with
/// a different content.
fn contents(performative: Performative, generator: &mut SchemaGenerator) -> Vec<Value> {
    match performative {
        Performative::Agree => vec![of::<Bid>(generator), of::<Agreement>(generator)],
        Performative::Cancel => vec![of::<CancelAction>(generator), of::<Withdrawal>(generator)],
        Performative::Request => vec![of::<Request>(generator)],
        Performative::Cfp => vec![of::<CallForProposals>(generator)],
        Performative::Propose => vec![of::<PlanProposal>(generator)],
        Performative::AcceptProposal | Performative::RejectProposal => {
            vec![of::<Choice>(generator)]
        }
        Performative::Refuse | Performative::NotUnderstood => vec![of::<Refusal>(generator)],
        Performative::Inform => vec![of::<Inform>(generator)],
        Performative::QueryRef => vec![of::<Question>(generator)],
        Performative::Confirm => vec![of::<Report>(generator)],
    }
}

/// Returns the schema of a message, with the schema of the content for each performative. The
/// schema of `Hello` is in `$defs`.
fn schema() -> Value {
    let mut generator = SchemaGenerator::default();
    let message = of::<Message>(&mut generator);
    let _hello = of::<Hello>(&mut generator);
    let by_performative: Vec<_> = Performative::ALL
        .into_iter()
        .map(|performative| {
            let content = contents(performative, &mut generator);
            json!({
                "if": { "properties": { "performative": { "const": performative } } },
                "then": { "properties": { "content": { "anyOf": content } } },
            })
        })
        .collect();
    json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": format!("A message of Althing's protocol, version {SCHEMA_VERSION}"),
        "description": "The first message to a plugin is $defs/Hello. Made from daemon/language/acl; see protocol.md.",
        "allOf": [message],
        "oneOf": [{ "allOf": by_performative }],
        "$defs": generator.definitions(),
    })
}

#[test]
fn the_published_schema_is_that_of_the_types() {
    let now = serde_json::to_string_pretty(&schema()).expect("it is JSON") + "\n";
    if std::env::var_os("UPDATE_EXPECT").is_some() {
        std::fs::write(FILE, &now).expect("the folder can be written to");
    }
    let published = std::fs::read_to_string(Path::new(FILE)).unwrap_or_default();
    assert!(published == now, "write it anew: UPDATE_EXPECT=1 cargo test -p acl schema");
}
