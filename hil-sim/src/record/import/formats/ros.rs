//! Messages of ROS 2: CDR with definitions in `.msg`.

use re_cdr::{BigEndian, CdrEndian, CdrReader, LittleEndian};
use re_ros_msg::MessageSchema;
use re_ros_msg::message_spec::{
    ArraySize, BuiltInType, ComplexType, MessageSpecification, Type, message_package,
};
use std::collections::HashMap;
use std::fmt::Write;

/// Messages within each other: those of ROS 2 have five levels.
const DEPTH_MAX: usize = 16;
/// Values that a message may have for each of its bytes: those of one byte in a message in an
/// array.
const VALUES_PER_BYTE: usize = 4;

/// The definition of one type of message with those of its parts.
pub(super) struct Definition {
    root: MessageSpecification,
    parts: HashMap<String, MessageSpecification>,
}

impl Definition {
    /// Reads the schema `text` of the message `name`, with its parts after lines of `=`.
    ///
    /// # Errors
    /// What was expected.
    pub fn parse(name: &str, text: &str) -> Result<Definition, String> {
        // Texts are not read, and the crate panics at one that is a single quotation mark.
        let unquoted = text.replace(['"', '\''], "_");
        let schema = MessageSchema::parse(&short(name), &unquoted);
        let schema = schema.map_err(|error| format!("a definition of {name}, {error:#}"))?;
        let parts = schema.dependencies.into_iter().map(|mut part| {
            part.name = short(&part.name);
            (part.name.clone(), part)
        });
        Ok(Definition {
            root: schema.spec,
            parts: parts.collect(),
        })
    }

    /// Passes each number of the message `bytes` to `visit`, with its name: `pose.x`, `data[0]`.
    ///
    /// # Errors
    /// What was expected of a message that is not of this definition.
    pub fn visit(&self, bytes: &[u8], visit: &mut dyn FnMut(&str, f64)) -> Result<(), String> {
        // The encapsulation: two bytes of representation and two of options (DDSI-RTPS, 10.2).
        match bytes {
            [0, 1, _, _, values @ ..] => self.walk::<LittleEndian>(values, visit),
            [0, 0, _, _, values @ ..] => self.walk::<BigEndian>(values, visit),
            _ => Err("CDR, found another representation".into()),
        }
    }

    fn walk<BO: CdrEndian>(
        &self,
        values: &[u8],
        visit: &mut dyn FnMut(&str, f64),
    ) -> Result<(), String> {
        let mut walk = Walk {
            parts: &self.parts,
            reader: CdrReader::<BO>::new(values),
            name: String::new(),
            values_left: VALUES_PER_BYTE * (1 + values.len()),
            visit,
        };
        walk.message(&self.root, DEPTH_MAX)
    }

    fn part<'a>(
        parts: &'a HashMap<String, MessageSpecification>,
        scope: &str,
        kind: &ComplexType,
    ) -> Result<&'a MessageSpecification, String> {
        let name = match kind {
            ComplexType::Absolute { package, name } => short(&format!("{package}/{name}")),
            ComplexType::Relative { name } => match message_package(scope) {
                Some(package) => format!("{package}/{name}"),
                None => name.clone(),
            },
        };
        let part = parts.get(&name);
        part.ok_or_else(|| format!("a definition of {name}, found none"))
    }
}

/// `package/Type` of a name that may be `package/msg/Type`.
fn short(name: &str) -> String {
    name.replace("/msg/", "/")
}

/// The way through one message.
struct Walk<'a, BO> {
    parts: &'a HashMap<String, MessageSpecification>,
    reader: CdrReader<'a, BO>,
    name: String,
    values_left: usize,
    visit: &'a mut dyn FnMut(&str, f64),
}

impl<BO: CdrEndian> Walk<'_, BO> {
    fn message(&mut self, message: &MessageSpecification, depth: usize) -> Result<(), String> {
        let length = self.name.len();
        for field in &message.fields {
            if length > 0 {
                self.name.push('.');
            }
            self.name += &field.name;
            self.value(&message.name, &field.ty, depth)?;
            self.name.truncate(length);
        }
        Ok(())
    }

    fn value(&mut self, scope: &str, kind: &Type, depth: usize) -> Result<(), String> {
        let (left, depth) = (self.values_left.checked_sub(1), depth.checked_sub(1));
        let (Some(left), Some(depth)) = (left, depth) else {
            return Err("values that end, found ones within each other".into());
        };
        self.values_left = left;
        match kind {
            Type::BuiltIn(kind) => self.scalar(kind),
            Type::Complex(kind) => {
                let part = Definition::part(self.parts, scope, kind)?;
                let octet = part.underlying_type_if_enum_like();
                match octet.map_err(|error| error.to_string())? {
                    Some(octet) => self.scalar(octet),
                    None if is_time(&part.name) => self.time(),
                    None => self.message(part, depth),
                }
            }
            Type::Array { ty, size } => {
                let count = match size {
                    ArraySize::Fixed(count) => *count,
                    ArraySize::Bounded(_) | ArraySize::Unbounded => {
                        let count = self.reader.read_u32();
                        count.map_err(|error| format!("the length of {}, {error}", self.name))?
                            as usize
                    }
                };
                let rest = self.reader.remaining();
                // No value of ROS 2 is shorter than a byte.
                if count > rest {
                    return Err(format!(
                        "{count} values of {}, found {rest} bytes",
                        self.name
                    ));
                }
                let length = self.name.len();
                for index in 0..count {
                    // A String takes whatever is written.
                    let _ = write!(self.name, "[{index}]");
                    self.value(scope, ty, depth)?;
                    self.name.truncate(length);
                }
                Ok(())
            }
        }
    }

    /// A `Time` or `Duration` as one number \[s\].
    fn time(&mut self) -> Result<(), String> {
        let parts = (self.reader.read_i32(), self.reader.read_u32());
        let (Ok(s), Ok(ns)) = parts else {
            return Err(format!("the time {}, found the end", self.name));
        };
        (self.visit)(&self.name, f64::from(s) + 1e-9 * f64::from(ns));
        Ok(())
    }

    fn scalar(&mut self, kind: &BuiltInType) -> Result<(), String> {
        let reader = &mut self.reader;
        let number = match kind {
            BuiltInType::Bool | BuiltInType::Byte | BuiltInType::Char | BuiltInType::UInt8 => {
                reader.read_u8().map(f64::from)
            }
            BuiltInType::Int8 => reader.read_i8().map(f64::from),
            BuiltInType::Int16 => reader.read_i16().map(f64::from),
            BuiltInType::UInt16 => reader.read_u16().map(f64::from),
            BuiltInType::Int32 => reader.read_i32().map(f64::from),
            BuiltInType::UInt32 => reader.read_u32().map(f64::from),
            // Measured values are exact in 53 bits.
            BuiltInType::Int64 => reader.read_i64().map(|number| number as f64),
            BuiltInType::UInt64 => reader.read_u64().map(|number| number as f64),
            BuiltInType::Float32 => reader.read_f32().map(f64::from),
            BuiltInType::Float64 => reader.read_f64(),
            BuiltInType::String(_) => {
                let text = reader.read_u32();
                let text = text.and_then(|length| reader.read_bytes(length as usize).map(drop));
                return text.map_err(|error| format!("the text {}, {error}", self.name));
            }
            BuiltInType::WString(_) => {
                return Err(format!("no wstring, found {}", self.name));
            }
        };
        let number = number.map_err(|error| format!("{} {kind:?}, {error}", self.name))?;
        (self.visit)(&self.name, number);
        Ok(())
    }
}

fn is_time(name: &str) -> bool {
    matches!(
        name,
        "builtin_interfaces/Time" | "builtin_interfaces/Duration"
    )
}
