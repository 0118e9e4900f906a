//! Logs of messages: MCAP with JSON, and bags of ROS 2.

use super::super::variable::{Content, Values, Variable};
use super::ros::Definition;
use super::{BadInput, Selector, numbers_max, unpacked_max};
use crate::record::mcap::each_record;
use mcap::MAGIC;
use mcap::records::Record;
use serde_json::Value;
use std::collections::HashMap;
use std::fmt::Write;
use std::rc::Rc;

/// The time at which a message was logged: of all topics, or as `/topic.log_time_s` of one.
const LOG_TIME: &str = "log_time_s";
/// Names of one topic that are listed.
const NAMES_MAX: usize = 200;
/// The longest message in JSON, whose values take up to a hundred times its bytes.
const JSON_MAX: usize = 1_000_000;

/// Whether the bytes are of an MCAP file.
pub(super) fn is_mcap(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// The `used` fields of the log `name`, one variable each, and the names of the others. Messages of
/// several topics are merged by the time of their log: each has a row, with gaps in the fields of
/// other topics.
///
/// # Errors
/// A damaged file, a message that is not as its schema says, or more than a file of its size has.
pub(super) fn read(name: &str, bytes: &[u8], used: &[&Selector]) -> Result<Content, BadInput> {
    let mut log = Log::open(name, bytes)?;
    log.want(used);
    let end = log.read(name, bytes)?;
    let notes = end.map(|error| format!("The file is damaged, read up to there: {error}."));
    Ok(Content::Variables {
        variables: log.variables(bytes.len(), name)?,
        format: "MCAP",
        notes: notes.into_iter().collect(),
    })
}

/// How the messages of a channel are read.
enum Decoder {
    Json,
    Ros(Definition),
    /// Not at all: what was expected.
    None(String),
}

/// Messages on one topic.
struct Topic {
    name: String,
    /// Of the numbers in the first message.
    names: Vec<String>,
    /// The time of each message that is read \[ns\].
    times_ns: Vec<u64>,
}

/// A number that is wanted of each message on a topic.
struct Wanted {
    /// As the mapping has it.
    name: String,
    topic: usize,
    field: String,
    values: Vec<f64>,
    is_found: bool,
}

/// Rows of the topics that are used.
struct Rows {
    /// The time of each \[ns\].
    times_ns: Vec<u64>,
    /// Of each topic, the message in each row; empty if there is one topic, with a row for each.
    messages: Vec<Vec<u32>>,
}

/// A row without a message of a topic.
const NO_MESSAGE: u32 = u32::MAX;

#[derive(Default)]
struct Log {
    channels: HashMap<u16, (usize, Rc<Decoder>)>,
    topics: Vec<Topic>,
    wanted: Vec<Wanted>,
    /// Whether [`LOG_TIME`] of all topics is wanted.
    is_timed: bool,
}

impl Log {
    /// The topics that have messages.
    fn open(name: &str, bytes: &[u8]) -> Result<Log, BadInput> {
        let mut schemas = HashMap::new();
        let mut channels = HashMap::new();
        let mut log = Log::default();
        each_record(name, bytes, unpacked_max(bytes.len()), |record| {
            match record {
                Record::Schema { header, data } => {
                    let schema = (header.name, header.encoding, data.into_owned());
                    schemas.entry(header.id).or_insert(Rc::new(schema));
                }
                Record::Channel(channel) => {
                    let schema = schemas.get(&channel.schema_id).cloned();
                    channels.entry(channel.id).or_insert((channel, schema));
                }
                Record::Message { header, data } => {
                    let id = header.channel_id;
                    if let Some((channel, schema)) = channels.get(&id)
                        && !log.channels.contains_key(&id)
                    {
                        let decoder = match (channel.message_encoding.as_str(), schema) {
                            ("json", _) => Decoder::Json,
                            ("cdr", Some(schema)) if schema.1 == "ros2msg" => {
                                let text = String::from_utf8_lossy(&schema.2);
                                let definition = Definition::parse(&schema.0, &text);
                                definition.map_or_else(Decoder::None, Decoder::Ros)
                            }
                            (encoding, schema) => {
                                let schema = schema.as_ref().map_or("none", |schema| &schema.1);
                                Decoder::None(other_encoding(encoding, schema, &channel.topic))
                            }
                        };
                        log.begin(id, &channel.topic, decoder, &data);
                    }
                }
                _ => {}
            }
            Ok(())
        })?;
        Ok(log)
    }

    /// Adds a channel with its first message.
    fn begin(&mut self, id: u16, topic: &str, decoder: Decoder, data: &[u8]) {
        let known = self.topics.iter().position(|known| known.name == topic);
        let index = known.unwrap_or(self.topics.len());
        if known.is_none() {
            self.topics.push(Topic {
                name: topic.into(),
                names: vec![LOG_TIME.into()],
                times_ns: Vec::new(),
            });
        }
        let names = &mut self.topics[index].names;
        // An error is one when the topic is read.
        let _ = decoder.visit(data, &mut |name, _| {
            if names.len() < NAMES_MAX && !names.iter().any(|known| known == name) {
                names.push(name.into());
            }
        });
        self.channels.insert(id, (index, Rc::new(decoder)));
    }

    /// The topic and the field of a name: `/topic.field`, or `field` if there is one topic.
    fn find(&self, name: &str) -> Option<(usize, String)> {
        let topics = self.topics.iter().enumerate();
        let named = topics.filter_map(|(index, topic)| {
            let field = name.strip_prefix(&topic.name)?.strip_prefix('.')?;
            Some((index, field.to_owned()))
        });
        // A topic may have dots in its name.
        let named = named.min_by_key(|(_, field)| field.len());
        let bare = (self.topics.len() == 1).then(|| (0, name.to_owned()));
        named.or(bare)
    }

    /// Takes note of the fields that are `used`.
    fn want(&mut self, used: &[&Selector]) {
        for selector in used {
            let Selector::Name(name) = selector else {
                continue;
            };
            if name == LOG_TIME {
                self.is_timed = true;
            } else if let Some((topic, field)) = self.find(name)
                && !self.wanted.iter().any(|wanted| wanted.name == *name)
            {
                self.wanted.push(Wanted {
                    name: name.clone(),
                    topic,
                    field,
                    values: Vec::new(),
                    is_found: false,
                });
            }
        }
    }

    /// Whether a field of the topic is wanted.
    fn is_used(&self, topic: usize) -> bool {
        self.wanted.iter().any(|wanted| wanted.topic == topic)
    }

    /// Reads what is wanted; what was expected where the file ends early.
    fn read(&mut self, name: &str, bytes: &[u8]) -> Result<Option<String>, BadInput> {
        let numbers_max = numbers_max(bytes.len());
        let mut numbers_left = numbers_max;
        each_record(name, bytes, unpacked_max(bytes.len()), |record| {
            let Record::Message { header, data } = record else {
                return Ok(());
            };
            let Some((index, decoder)) = self.channels.get(&header.channel_id) else {
                return Ok(());
            };
            let (index, decoder) = (*index, Rc::clone(decoder));
            if !self.is_used(index) {
                return Ok(());
            }
            let topic = &mut self.topics[index];
            topic.times_ns.push(header.log_time);
            let row = topic.times_ns.len();
            let bad = |expected: String| BadInput {
                place: Some(format!("topic `{}`, message {row}", topic.name)),
                ..BadInput::file(name, expected)
            };
            let mut wanted: Vec<_> = self.wanted.iter_mut().collect();
            wanted.retain(|wanted| wanted.topic == index);
            let left = numbers_left.checked_sub(1 + wanted.len());
            numbers_left = left.ok_or_else(|| too_many(name, numbers_max))?;
            for wanted in &mut wanted {
                let is_time = wanted.field == LOG_TIME;
                wanted.is_found |= is_time;
                let value = if is_time {
                    seconds(header.log_time)
                } else {
                    f64::NAN
                };
                wanted.values.push(value);
            }
            let visited = decoder.visit(&data, &mut |field, value| {
                for wanted in &mut wanted {
                    if wanted.field == field
                        && let Some(last) = wanted.values.last_mut()
                    {
                        *last = value;
                        wanted.is_found = true;
                    }
                }
            });
            visited.map_err(bad)
        })
    }

    /// The variables that were read, on common rows, and the names of the others.
    fn variables(mut self, file_bytes: usize, name: &str) -> Result<Vec<Variable>, BadInput> {
        // A field that no message has does not exist.
        self.wanted.retain(|wanted| wanted.is_found);
        let used: Vec<_> = (0..self.topics.len())
            .filter(|of| self.is_used(*of))
            .collect();
        if used.len() > 1 && !self.is_timed {
            let names: Vec<_> = used.iter().map(|of| &*self.topics[*of].name).collect();
            let expected = format!(
                "fields of one topic, or `time.column = \"{LOG_TIME}\"`, which merges several, \
                 found {}",
                names.join(", ")
            );
            return Err(BadInput::file(name, expected));
        }
        let rows = self.rows(&used);
        let count = rows.times_ns.len();
        let cells = count.checked_mul(1 + self.wanted.len());
        if cells.is_none_or(|cells| cells > numbers_max(file_bytes)) {
            return Err(too_many(name, numbers_max(file_bytes)));
        }
        let variable = |name: String, values: Vec<f64>| Variable {
            name,
            height: count,
            width: 1,
            values: Values::Read(values),
        };
        let mut variables = Vec::new();
        if self.is_timed {
            let times_s = rows.times_ns.iter().map(|time_ns| seconds(*time_ns));
            variables.push(variable(LOG_TIME.into(), times_s.collect()));
        }
        for wanted in &mut self.wanted {
            let read = std::mem::take(&mut wanted.values);
            let topic = used.iter().position(|of| *of == wanted.topic);
            let messages = topic.and_then(|topic| rows.messages.get(topic));
            let values = match messages {
                None => read,
                Some(messages) => {
                    let value = |message: &u32| read.get(*message as usize).copied();
                    let values = messages.iter().map(value);
                    values.map(|value| value.unwrap_or(f64::NAN)).collect()
                }
            };
            variables.push(variable(wanted.name.clone(), values));
        }
        let is_single = self.topics.len() == 1;
        for (index, topic) in self.topics.iter().enumerate() {
            let is_wanted = |field: &String| {
                let mut wanted = self.wanted.iter();
                wanted.any(|wanted| wanted.topic == index && wanted.field == *field)
                    || is_single && self.is_timed && field == LOG_TIME
            };
            for field in topic.names.iter().filter(|field| !is_wanted(field)) {
                let name = match is_single {
                    true => field.clone(),
                    false => format!("{}.{field}", topic.name),
                };
                variables.push(variable(name, Vec::new()));
            }
        }
        Ok(variables)
    }

    /// The rows of the `used` topics: of several, one for each time of a log.
    fn rows(&self, used: &[usize]) -> Rows {
        // Those of one topic stay in the order of the file: `time.restarted` corrects them.
        if let [topic] = used {
            return Rows {
                times_ns: self.topics[*topic].times_ns.clone(),
                messages: Vec::new(),
            };
        }
        let messages = used.iter().enumerate().flat_map(|(column, topic)| {
            let times_ns = self.topics[*topic].times_ns.iter().enumerate();
            // Their number is limited.
            times_ns.map(move |(message, time_ns)| (*time_ns, column, message as u32))
        });
        let mut messages: Vec<_> = messages.collect();
        messages.sort_unstable();
        let mut rows = Rows {
            times_ns: Vec::new(),
            messages: vec![Vec::new(); used.len()],
        };
        for (time_ns, column, message) in messages {
            let is_same = rows.times_ns.last() == Some(&time_ns)
                && rows.messages[column].last() == Some(&NO_MESSAGE);
            if !is_same {
                rows.times_ns.push(time_ns);
                for column in &mut rows.messages {
                    column.push(NO_MESSAGE);
                }
            }
            if let Some(last) = rows.messages[column].last_mut() {
                *last = message;
            }
        }
        rows
    }
}

impl Decoder {
    /// Passes each number of the message `data` to `visit`, with its name.
    fn visit(&self, data: &[u8], visit: &mut dyn FnMut(&str, f64)) -> Result<(), String> {
        match self {
            Decoder::Json if data.len() > JSON_MAX => {
                let found = data.len();
                Err(format!(
                    "messages of at most {JSON_MAX} bytes, found {found}"
                ))
            }
            Decoder::Json => {
                let value: Value = serde_json::from_slice(data)
                    .map_err(|error| format!("a message in JSON, {error}"))?;
                visit_json(&value, &mut String::new(), visit);
                Ok(())
            }
            Decoder::Ros(definition) => definition.visit(data, visit),
            Decoder::None(expected) => Err(expected.clone()),
        }
    }
}

/// Passes each number in `value` to `visit`, with its name: `rig.pressure`, `data[0]`.
fn visit_json(value: &Value, name: &mut String, visit: &mut dyn FnMut(&str, f64)) {
    let length = name.len();
    match value {
        Value::Number(number) => visit(name, number.as_f64().unwrap_or(f64::NAN)),
        Value::Bool(is_true) => visit(name, f64::from(u8::from(*is_true))),
        Value::Object(fields) => {
            for (field, value) in fields {
                if length > 0 {
                    name.push('.');
                }
                *name += field;
                visit_json(value, name, visit);
                name.truncate(length);
            }
        }
        Value::Array(values) => {
            for (index, value) in values.iter().enumerate() {
                // A String takes whatever is written.
                let _ = write!(name, "[{index}]");
                visit_json(value, name, visit);
                name.truncate(length);
            }
        }
        Value::Null | Value::String(_) => {}
    }
}

/// What is expected of a channel in another encoding, and the command that converts it.
fn other_encoding(encoding: &str, schema: &str, topic: &str) -> String {
    let command = match encoding {
        "cdr" => format!("`ros2 topic echo --csv {topic}` beside `ros2 bag play`"),
        _ => format!("`mcap cat FILE --topics {topic} --json`"),
    };
    format!(
        "messages in JSON, or in CDR with ros2msg ({command} prints others), found {encoding} with \
         {schema}"
    )
}

/// More numbers than a file of its size has.
fn too_many(name: &str, max: usize) -> BadInput {
    let expected = format!("at most {max} numbers of a file of its size, found more");
    BadInput::file(name, expected)
}

fn seconds(time_ns: u64) -> f64 {
    time_ns as f64 / 1e9
}
