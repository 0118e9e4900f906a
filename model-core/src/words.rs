//! A value as words: what is stored inverted.

use core::fmt::{Display, Formatter, Result as Formatted};
use serde::ser::{
    Error, Impossible, Serialize, SerializeStruct, SerializeTuple, SerializeTupleStruct, Serializer,
};

/// Writes the inverted words of `value`: one for each number, each variant of an enumeration and
/// each option. Those that `words` has beyond them are zero. Returns the number of words of the
/// value, which must fit.
pub(crate) fn invert<T: Serialize, const N: usize>(value: &T, words: &mut [u32; N]) -> usize {
    let mut writer = Writer { words, count: 0 };
    // It fails for text, sequences and maps, which no such value contains.
    let _ = value.serialize(&mut writer);
    let count = writer.count;
    if let Some(rest) = words.get_mut(count..) {
        rest.fill(0);
    }
    count
}

struct Writer<'a, const N: usize> {
    words: &'a mut [u32; N],
    count: usize,
}

impl<const N: usize> Writer<'_, N> {
    #[inline(always)]
    fn put(&mut self, word: u32) -> Result<(), Unsupported> {
        if let Some(slot) = self.words.get_mut(self.count) {
            *slot = !word;
        }
        self.count += 1;
        Ok(())
    }
}

/// A value with a part of variable length.
#[derive(Debug)]
struct Unsupported;

impl Display for Unsupported {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> Formatted {
        formatter.write_str("a value of variable length")
    }
}

impl core::error::Error for Unsupported {}

impl Error for Unsupported {
    fn custom<T: Display>(_: T) -> Unsupported {
        Unsupported
    }
}

/// Numbers that fit into a word.
macro_rules! numbers {
    ($($method:ident: $type:ty),*) => {
        $(
            #[inline(always)]
            fn $method(self, value: $type) -> Result<(), Unsupported> {
                self.put(value as u32)
            }
        )*
    };
}

/// What has more than a word, or a variable length.
macro_rules! unsupported {
    ($($method:ident: $type:ty),*) => {
        $(
            fn $method(self, _: $type) -> Result<(), Unsupported> {
                Err(Unsupported)
            }
        )*
    };
}

impl<const N: usize> Serializer for &mut Writer<'_, N> {
    type Ok = ();
    type Error = Unsupported;
    type SerializeSeq = Impossible<(), Unsupported>;
    type SerializeTuple = Self;
    type SerializeTupleStruct = Self;
    type SerializeTupleVariant = Impossible<(), Unsupported>;
    type SerializeMap = Impossible<(), Unsupported>;
    type SerializeStruct = Self;
    type SerializeStructVariant = Impossible<(), Unsupported>;

    numbers! {
        serialize_bool: bool, serialize_i8: i8, serialize_i16: i16, serialize_i32: i32,
        serialize_u8: u8, serialize_u16: u16, serialize_u32: u32, serialize_char: char
    }

    unsupported! {
        serialize_i64: i64, serialize_u64: u64, serialize_f64: f64, serialize_str: &str,
        serialize_bytes: &[u8]
    }

    #[inline(always)]
    fn serialize_f32(self, value: f32) -> Result<(), Unsupported> {
        self.put(value.to_bits())
    }

    #[inline(always)]
    fn serialize_none(self) -> Result<(), Unsupported> {
        self.put(0)
    }

    #[inline(always)]
    fn serialize_some<T: Serialize + ?Sized>(self, value: &T) -> Result<(), Unsupported> {
        self.put(1)?;
        value.serialize(self)
    }

    fn serialize_unit(self) -> Result<(), Unsupported> {
        Ok(())
    }

    fn serialize_unit_struct(self, _: &'static str) -> Result<(), Unsupported> {
        Ok(())
    }

    #[inline(always)]
    fn serialize_unit_variant(
        self,
        _: &'static str,
        index: u32,
        _: &'static str,
    ) -> Result<(), Unsupported> {
        self.put(index)
    }

    #[inline(always)]
    fn serialize_newtype_struct<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        value: &T,
    ) -> Result<(), Unsupported> {
        value.serialize(self)
    }

    #[inline(always)]
    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        index: u32,
        _: &'static str,
        value: &T,
    ) -> Result<(), Unsupported> {
        self.put(index)?;
        value.serialize(self)
    }

    fn serialize_seq(self, _: Option<usize>) -> Result<Self::SerializeSeq, Unsupported> {
        Err(Unsupported)
    }

    #[inline(always)]
    fn serialize_tuple(self, _: usize) -> Result<Self, Unsupported> {
        Ok(self)
    }

    #[inline(always)]
    fn serialize_tuple_struct(self, _: &'static str, _: usize) -> Result<Self, Unsupported> {
        Ok(self)
    }

    fn serialize_tuple_variant(
        self,
        _: &'static str,
        _: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Self::SerializeTupleVariant, Unsupported> {
        Err(Unsupported)
    }

    fn serialize_map(self, _: Option<usize>) -> Result<Self::SerializeMap, Unsupported> {
        Err(Unsupported)
    }

    #[inline(always)]
    fn serialize_struct(self, _: &'static str, _: usize) -> Result<Self, Unsupported> {
        Ok(self)
    }

    fn serialize_struct_variant(
        self,
        _: &'static str,
        _: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Self::SerializeStructVariant, Unsupported> {
        Err(Unsupported)
    }

    fn collect_str<T: Display + ?Sized>(self, _: &T) -> Result<(), Unsupported> {
        Err(Unsupported)
    }
}

/// Parts of structs, tuples and arrays.
macro_rules! parts {
    ($trait:ident, $method:ident$(, $name:ty)?) => {
        impl<const N: usize> $trait for &mut Writer<'_, N> {
            type Ok = ();
            type Error = Unsupported;

            #[inline(always)]
            fn $method<T: Serialize + ?Sized>(
                &mut self,
                $(_: $name,)?
                value: &T,
            ) -> Result<(), Unsupported> {
                value.serialize(&mut **self)
            }

            #[inline(always)]
            fn end(self) -> Result<(), Unsupported> {
                Ok(())
            }
        }
    };
}

parts!(SerializeStruct, serialize_field, &'static str);
parts!(SerializeTuple, serialize_element);
parts!(SerializeTupleStruct, serialize_field);
