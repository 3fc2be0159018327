//! A few numbers for plots, as JSON with a JSON schema.

use crate::views::unix_ns;
use foxglove::{Context, FoxgloveError, PartialMetadata, RawChannel, Schema};
use jink_shared_types::{SampleHeader, Timestamp};
use serde_json::{Map, Value, json};
use std::sync::Arc;

/// A channel with `N` numbers, each with its name. What is no finite number is left out of a message.
pub struct Numbers<const N: usize> {
    channel: Arc<RawChannel>,
    names: [&'static str; N],
    due: Timestamp,
}

impl<const N: usize> Numbers<N> {
    /// Of fields with names and descriptions.
    ///
    /// # Errors
    /// A channel that Foxglove's library does not take.
    pub fn new(
        context: &Arc<Context>,
        topic: &str,
        fields: [(&'static str, &'static str); N],
    ) -> Result<Self, FoxgloveError> {
        let property =
            |(name, docs): (&str, &str)| (name.to_owned(), json!({ "type": "number", "description": docs }));
        let properties: Map<String, Value> = fields.into_iter().map(property).collect();
        let name = format!("jink{}", topic.replace('/', "."));
        let schema = json!({ "title": name, "type": "object", "properties": properties }).to_string();
        let channel = context
            .channel_builder(topic)
            .message_encoding("json")
            .schema(Schema::new(name, "jsonschema", schema.into_bytes()))
            .build_raw()?;
        Ok(Self {
            channel,
            names: fields.map(|(name, _)| name),
            due: Timestamp::NEVER,
        })
    }

    /// Whether somebody has subscribed to it.
    pub fn is_wanted(&self) -> bool {
        self.channel.has_sinks()
    }

    /// Logs the numbers of a sample, if enough time has passed.
    pub fn log(&mut self, header: &SampleHeader, ahead_ns: i64, period_s: f64, values: [f64; N]) {
        if !self.is_wanted() || header.publish < self.due {
            return;
        }
        self.due = header.publish.plus_seconds(period_s);
        let known = self
            .names
            .iter()
            .zip(values)
            .filter(|(_, value)| value.is_finite());
        let message: Map<String, Value> = known
            .map(|(name, value)| ((*name).to_owned(), json!(value)))
            .collect();
        let time = PartialMetadata::with_log_time(unix_ns(header.publish, ahead_ns));
        self.channel
            .log_with_meta(Value::Object(message).to_string().as_bytes(), time);
    }
}
