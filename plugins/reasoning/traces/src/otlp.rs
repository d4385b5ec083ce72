//! Spans as OTLP messages: the JSON encoding of `ExportTraceServiceRequest`, which every collector
//! takes over HTTP.

use serde_json::{Value, json};

use crate::span::{Attribute, AttributeValue, SpanLink, SpanStatus, TraceSpan};

/// Kind of a span in OTLP: work within the application.
const SPAN_KIND_INTERNAL: u32 = 1;

/// Codes of a span's status in OTLP.
const STATUS_OK: u32 = 1;
const STATUS_ERROR: u32 = 2;

/// Name of the instrumentation scope.
const SCOPE: &str = "althing.traces";

/// Returns the request that hands spans of one resource to a collector.
pub(crate) fn request(resource: &[Attribute], spans: &[TraceSpan]) -> Value {
    let spans: Vec<Value> = spans.iter().map(span).collect();
    let scope = json!({ "name": SCOPE, "version": env!("CARGO_PKG_VERSION") });
    json!({ "resourceSpans": [{
        "resource": { "attributes": attributes(resource) },
        "scopeSpans": [{ "scope": scope, "spans": spans }],
    }] })
}

fn span(span: &TraceSpan) -> Value {
    let mut value = json!({
        "traceId": span.trace.to_string(),
        "spanId": span.id.to_string(),
        "name": span.name,
        "kind": SPAN_KIND_INTERNAL,
        // 64-bit numbers are texts in this encoding.
        "startTimeUnixNano": span.start.0.to_string(),
        "endTimeUnixNano": span.end.0.to_string(),
        "attributes": attributes(&span.attributes),
        "links": span.links.iter().map(link).collect::<Vec<_>>(),
        "status": status(&span.status),
    });
    if let Some(parent) = span.parent {
        value["parentSpanId"] = json!(parent.to_string());
    }
    value
}

fn link(link: &SpanLink) -> Value {
    let relation = ("althing.link.relation", AttributeValue::from(link.relation));
    json!({
        "traceId": link.trace.to_string(),
        "spanId": link.span.to_string(),
        "attributes": attributes(&[relation]),
    })
}

fn status(status: &SpanStatus) -> Value {
    match status {
        SpanStatus::Unset => json!({}),
        SpanStatus::Done => json!({ "code": STATUS_OK }),
        SpanStatus::Failed(why) => json!({ "code": STATUS_ERROR, "message": why }),
    }
}

fn attributes(attributes: &[Attribute]) -> Value {
    attributes.iter().map(|(name, value)| json!({ "key": name, "value": any(value) })).collect()
}

fn any(value: &AttributeValue) -> Value {
    match value {
        AttributeValue::Text(text) => json!({ "stringValue": text }),
        AttributeValue::Integer(number) => json!({ "intValue": number.to_string() }),
        AttributeValue::Number(number) => json!({ "doubleValue": number }),
        AttributeValue::Flag(flag) => json!({ "boolValue": flag }),
        AttributeValue::Texts(texts) => {
            let values: Vec<_> = texts.iter().map(|text| json!({ "stringValue": text })).collect();
            json!({ "arrayValue": { "values": values } })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::span::{SpanId, TraceId, UnixNanos};

    #[test]
    fn a_span_is_encoded_as_otlp_defines_it() {
        let trace = TraceId::of("lab", "c1");
        let (id, parent) = (SpanId::of(trace, "action", "1"), SpanId::of(trace, "goal", ""));
        let link = SpanLink { trace, span: parent, relation: "replaces" };
        let spans = [TraceSpan {
            trace,
            id,
            parent: Some(parent),
            name: "action".to_owned(),
            start: UnixNanos(u64::MAX),
            end: UnixNanos(u64::MAX),
            attributes: vec![
                ("a", AttributeValue::Integer(-3)),
                ("b", AttributeValue::Number(0.5)),
                ("c", AttributeValue::Flag(true)),
                ("d", AttributeValue::Texts(vec!["x".to_owned()])),
            ],
            links: vec![link],
            status: SpanStatus::Failed("stuck".to_owned()),
        }];
        let request = request(&[("service.name", "althing".into())], &spans);
        let resource = &request["resourceSpans"][0];
        let name = &resource["resource"]["attributes"][0];
        assert_eq!(name["key"], "service.name");
        assert_eq!(name["value"]["stringValue"], "althing");
        let span = &resource["scopeSpans"][0]["spans"][0];
        assert_eq!(span["startTimeUnixNano"], u64::MAX.to_string(), "a text keeps all digits");
        assert_eq!(span["parentSpanId"], parent.to_string());
        assert_eq!(span["status"], json!({ "code": 2, "message": "stuck" }));
        let values: Vec<_> = (0..4).map(|at| span["attributes"][at]["value"].clone()).collect();
        let array = json!({ "arrayValue": { "values": [{ "stringValue": "x" }] } });
        let numbers = [json!({ "intValue": "-3" }), json!({ "doubleValue": 0.5 })];
        assert_eq!(values[..2], numbers);
        assert_eq!(values[2..], [json!({ "boolValue": true }), array]);
        assert_eq!(span["links"][0]["spanId"], parent.to_string());
    }
}
