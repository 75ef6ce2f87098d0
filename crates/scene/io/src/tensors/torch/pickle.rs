//! Python's pickle machine, as far as descriptions of tensors need it. It calls nothing.
//!
//! All objects lie in one list and refer to others by index, so that no program can build an object too deep to be
//! dropped.

use std::collections::BTreeMap;

/// The place of a [`Node`].
pub type Id = u32;

/// Something that the program made.
#[derive(Clone, Debug, PartialEq)]
pub enum Node {
    Nothing,
    Number(i64),
    Text(String),
    List(Vec<Id>),
    Dict(Vec<(Id, Id)>),
    /// The name of a class or function, module first.
    Global(String),
    Storage(Storage),
    Tensor(Tensor),
    /// An entry of no concern here.
    Other,
}

/// Numbers in a file of the archive.
#[derive(Clone, Debug, PartialEq)]
pub struct Storage {
    /// The class, such as `FloatStorage`, or the type, such as `float32`, where the class has none.
    pub kind: String,
    /// The file's name.
    pub key: String,
    /// Number of numbers.
    pub len: u64,
}

impl Storage {
    /// The type in safetensors headers, and its bytes.
    pub fn dtype(&self) -> Option<(&'static str, usize)> {
        Some(match self.kind.as_str() {
            "FloatStorage" | "float32" => ("F32", 4),
            "HalfStorage" | "float16" => ("F16", 2),
            "BFloat16Storage" | "bfloat16" => ("BF16", 2),
            "DoubleStorage" | "float64" => ("F64", 8),
            "LongStorage" | "int64" => ("I64", 8),
            "IntStorage" | "int32" => ("I32", 4),
            "ShortStorage" | "int16" => ("I16", 2),
            "CharStorage" | "int8" => ("I8", 1),
            "ByteStorage" | "uint8" => ("U8", 1),
            "BoolStorage" | "bool" => ("BOOL", 1),
            _ => return None,
        })
    }
}

/// A view of a storage.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    pub storage: Storage,
    pub offset: usize,
    pub shape: Vec<usize>,
    pub strides: Vec<usize>,
}

impl Tensor {
    /// True if its numbers follow one another, row-major.
    pub fn is_contiguous(&self) -> bool {
        let mut expected = 1;
        self.shape.iter().zip(&self.strides).rev().all(|(n, stride)| {
            let fits = *n == 1 || *stride == expected;
            expected *= n;
            fits
        }) || self.shape.contains(&0)
    }

    /// Numbers from the first to the last that belongs to it; nothing if there are more than can be counted.
    pub fn span(&self) -> Option<usize> {
        if self.shape.contains(&0) {
            return Some(0);
        }
        let reach = |reach: usize, (n, stride): (&usize, &usize)| reach.checked_add((n - 1).checked_mul(*stride)?);
        self.shape.iter().zip(&self.strides).try_fold(1, reach)
    }

    /// Where element `i` (row-major) is, counted from the first. Below the span.
    pub fn position(&self, mut i: usize) -> usize {
        let mut at = 0;
        for (n, stride) in self.shape.iter().zip(&self.strides).rev() {
            at += i % n * stride;
            i /= n;
        }
        at
    }
}

/// The machine after its program.
pub struct Machine<'p> {
    program: &'p [u8],
    at: usize,
    nodes: Vec<Node>,
    stack: Vec<Id>,
    marks: Vec<usize>,
    memo: BTreeMap<u32, Id>,
}

type Outcome<T> = Result<T, String>;

impl<'p> Machine<'p> {
    /// Runs a program to its end.
    pub fn run(program: &'p [u8]) -> Outcome<Self> {
        let nodes = vec![Node::Nothing];
        let mut machine = Self { program, at: 0, nodes, stack: Vec::new(), marks: Vec::new(), memo: BTreeMap::new() };
        while machine.step().map_err(|fault| format!("{fault} at byte {}", machine.at))? {}
        Ok(machine)
    }

    /// The result of the program.
    pub fn result(&self) -> Id {
        self.stack.last().copied().unwrap_or(0)
    }

    pub fn node(&self, id: Id) -> &Node {
        &self.nodes[id as usize]
    }

    fn bytes(&mut self, count: usize) -> Outcome<&'p [u8]> {
        let end = self.at.checked_add(count).filter(|end| *end <= self.program.len());
        let bytes = &self.program[self.at..end.ok_or("the program ends in the middle")?];
        self.at += count;
        Ok(bytes)
    }

    fn array<const N: usize>(&mut self) -> Outcome<[u8; N]> {
        Ok(self.bytes(N)?.try_into().expect("as many bytes as asked for"))
    }

    fn size(&mut self, width: usize) -> Outcome<usize> {
        let mut wide = [0; 8];
        wide[..width].copy_from_slice(self.bytes(width)?);
        usize::try_from(u64::from_le_bytes(wide)).map_err(|e| e.to_string())
    }

    fn line(&mut self) -> Outcome<String> {
        let rest = &self.program[self.at..];
        let end = rest.iter().position(|b| *b == b'\n').ok_or("the program ends in the middle")?;
        let line = String::from_utf8_lossy(&rest[..end]).into_owned();
        self.at += end + 1;
        Ok(line)
    }

    fn text(&mut self, width: usize) -> Outcome<()> {
        let size = self.size(width)?;
        let text = String::from_utf8_lossy(self.bytes(size)?).into_owned();
        self.push(Node::Text(text));
        Ok(())
    }

    fn push(&mut self, node: Node) {
        self.nodes.push(node);
        self.stack.push(self.nodes.len() as Id - 1);
    }

    fn pop(&mut self) -> Outcome<Id> {
        // Values below a mark cannot be popped.
        let floor = self.marks.last().copied().unwrap_or(0);
        if self.stack.len() <= floor {
            Err("nothing left on the stack".into())
        } else {
            Ok(self.stack.remove(self.stack.len() - 1))
        }
    }

    fn pop_to_mark(&mut self) -> Outcome<Vec<Id>> {
        let mark = self.marks.pop().ok_or("no mark on the stack")?;
        Ok(self.stack.split_off(mark))
    }

    fn top(&mut self) -> Outcome<&mut Node> {
        let id = *self.stack.last().ok_or("nothing on the stack")?;
        Ok(&mut self.nodes[id as usize])
    }

    fn remember(&mut self, index: u32) -> Outcome<()> {
        let id = *self.stack.last().ok_or("nothing on the stack")?;
        self.memo.insert(index, id);
        Ok(())
    }

    fn recall(&mut self, index: u32) -> Outcome<()> {
        let id = *self.memo.get(&index).ok_or_else(|| format!("nothing remembered as {index}"))?;
        self.stack.push(id);
        Ok(())
    }

    fn tuple(&mut self, count: usize) -> Outcome<()> {
        let mut items = (0..count).map(|_| self.pop()).collect::<Outcome<Vec<_>>>()?;
        items.reverse();
        self.push(Node::List(items));
        Ok(())
    }

    fn set(&mut self, items: &[Id]) -> Outcome<()> {
        if let Node::Dict(entries) = self.top()? {
            entries.extend(items.chunks_exact(2).map(|pair| (pair[0], pair[1])));
        }
        Ok(())
    }

    fn append(&mut self, items: &[Id]) -> Outcome<()> {
        if let Node::List(list) = self.top()? {
            list.extend(items);
        }
        Ok(())
    }

    /// One instruction; false at the end.
    fn step(&mut self) -> Outcome<bool> {
        let code = self.array::<1>()?[0];
        match code {
            b'.' => return Ok(false),
            // PROTO and FRAME say nothing that matters here.
            0x80 => drop(self.bytes(1)?),
            0x95 => drop(self.bytes(8)?),
            b'N' => self.push(Node::Nothing),
            0x88 => self.push(Node::Number(1)),
            0x89 => self.push(Node::Number(0)),
            b'J' => {
                let number = i32::from_le_bytes(self.array()?);
                self.push(Node::Number(number.into()));
            }
            b'K' => {
                let number = self.size(1)?;
                self.push(Node::Number(number as i64));
            }
            b'M' => {
                let number = self.size(2)?;
                self.push(Node::Number(number as i64));
            }
            0x8a => self.long(1)?,
            0x8b => self.long(4)?,
            b'G' => {
                self.bytes(8)?;
                self.push(Node::Other);
            }
            b'I' | b'L' | b'F' => {
                let line = self.line()?;
                self.push(line.trim_end_matches('L').parse().map_or(Node::Other, Node::Number));
            }
            b'X' | b'T' | b'B' => self.text(4)?,
            0x8c | b'U' | b'C' => self.text(1)?,
            0x8d | 0x8e | 0x96 => self.text(8)?,
            b'V' | b'S' => {
                let line = self.line()?;
                self.push(Node::Text(line.trim_matches('\'').to_string()));
            }
            b'}' => self.push(Node::Dict(Vec::new())),
            b']' | b')' | 0x8f => self.push(Node::List(Vec::new())),
            b'(' => self.marks.push(self.stack.len()),
            b't' | b'l' | 0x91 => {
                let items = self.pop_to_mark()?;
                self.push(Node::List(items));
            }
            b'd' => {
                let items = self.pop_to_mark()?;
                self.push(Node::Dict(Vec::new()));
                self.set(&items)?;
            }
            0x85..=0x87 => self.tuple(usize::from(code - 0x84))?,
            b's' => {
                let value = self.pop()?;
                let key = self.pop()?;
                self.set(&[key, value])?;
            }
            b'u' => {
                let items = self.pop_to_mark()?;
                self.set(&items)?;
            }
            b'a' => {
                let item = self.pop()?;
                self.append(&[item])?;
            }
            b'e' | 0x90 => {
                let items = self.pop_to_mark()?;
                self.append(&items)?;
            }
            b'q' => {
                let index = self.size(1)? as u32;
                self.remember(index)?;
            }
            b'r' => {
                let index = self.size(4)? as u32;
                self.remember(index)?;
            }
            0x94 => {
                let index = self.memo.len() as u32;
                self.remember(index)?;
            }
            b'h' => {
                let index = self.size(1)? as u32;
                self.recall(index)?;
            }
            b'j' => {
                let index = self.size(4)? as u32;
                self.recall(index)?;
            }
            b'0' => drop(self.pop()?),
            b'1' => drop(self.pop_to_mark()?),
            b'2' => {
                let id = *self.stack.last().ok_or("nothing on the stack")?;
                self.stack.push(id);
            }
            b'c' => {
                let (module, name) = (self.line()?, self.line()?);
                self.push(Node::Global(format!("{module}.{name}")));
            }
            0x93 => {
                let (name, module) = (self.pop()?, self.pop()?);
                let global = match (self.node(module), self.node(name)) {
                    (Node::Text(module), Node::Text(name)) => Node::Global(format!("{module}.{name}")),
                    _ => return Err("a name that is no text".into()),
                };
                self.push(global);
            }
            b'Q' => self.persistent()?,
            b'R' | 0x81 => {
                let (arguments, callee) = (self.pop()?, self.pop()?);
                self.call(callee, arguments);
            }
            0x92 => {
                let (_, arguments, callee) = (self.pop()?, self.pop()?, self.pop()?);
                self.call(callee, arguments);
            }
            // The state of an object. Of the objects that are made here, none has any that matters.
            b'b' => drop(self.pop()?),
            other => return Err(format!("instruction {other:#04x} is not known")),
        }
        Ok(true)
    }

    fn long(&mut self, width: usize) -> Outcome<()> {
        let size = self.size(width)?;
        let bytes = self.bytes(size)?;
        let mut wide = if bytes.last().is_some_and(|b| b & 0x80 != 0) { [0xff; 8] } else { [0; 8] };
        let node = if size <= 8 {
            wide[..size].copy_from_slice(bytes);
            Node::Number(i64::from_le_bytes(wide))
        } else {
            Node::Other
        };
        self.push(node);
        Ok(())
    }

    fn items(&self, id: Id) -> &[Id] {
        match self.node(id) {
            Node::List(items) => items,
            _ => &[],
        }
    }

    fn number(&self, id: Option<&Id>) -> Option<u64> {
        match self.node(*id?) {
            Node::Number(number) => u64::try_from(*number).ok(),
            _ => None,
        }
    }

    /// `('storage', class, key, device, length)`.
    fn persistent(&mut self) -> Outcome<()> {
        let id = self.pop()?;
        let items = self.items(id);
        let text = |i: usize| match items.get(i).map(|id| self.node(*id)) {
            Some(Node::Text(text) | Node::Global(text)) => Some(text.as_str()),
            _ => None,
        };
        let storage = match (text(0), text(1), text(2), self.number(items.get(4))) {
            (Some("storage"), Some(class), Some(key), Some(len)) => {
                let kind = class.rsplit('.').next().unwrap_or(class).to_string();
                Node::Storage(Storage { kind, key: key.to_string(), len })
            }
            _ => return Err("a reference to something that is no storage".into()),
        };
        self.push(storage);
        Ok(())
    }

    /// The result of a call, where it is known; nothing is called.
    fn call(&mut self, callee: Id, arguments: Id) {
        let node = match self.node(callee) {
            Node::Global(name) => match name.as_str() {
                "collections.OrderedDict" | "builtins.dict" | "__builtin__.dict" => Node::Dict(Vec::new()),
                "torch._utils._rebuild_tensor_v2" | "torch._utils._rebuild_tensor" => {
                    self.tensor(arguments, None).map_or(Node::Other, Node::Tensor)
                }
                "torch._utils._rebuild_tensor_v3" => {
                    let kind = match self.items(arguments).get(6).map(|id| self.node(*id)) {
                        Some(Node::Global(name)) => name.rsplit('.').next().map(str::to_string),
                        _ => None,
                    };
                    self.tensor(arguments, kind).map_or(Node::Other, Node::Tensor)
                }
                "torch._utils._rebuild_parameter" | "torch._utils._rebuild_parameter_with_state" => {
                    self.items(arguments).first().map_or(Node::Other, |id| self.node(*id).clone())
                }
                _ => Node::Other,
            },
            _ => Node::Other,
        };
        self.push(node);
    }

    /// `(storage, offset, shape, strides, ...)`.
    fn tensor(&self, arguments: Id, kind: Option<String>) -> Option<Tensor> {
        let items = self.items(arguments);
        let Node::Storage(storage) = self.node(*items.first()?) else { return None };
        let list = |i: usize| -> Option<Vec<usize>> {
            self.items(*items.get(i)?).iter().map(|id| self.number(Some(id)).map(|n| n as usize)).collect()
        };
        let mut storage = storage.clone();
        if let Some(kind) = kind {
            // An untyped storage counts bytes.
            storage.kind = kind;
            storage.len /= storage.dtype()?.1 as u64;
        }
        let (shape, strides) = (list(2)?, list(3)?);
        let counted = shape.iter().try_fold(1usize, |n, d| n.checked_mul(*d));
        let fits = shape.len() == strides.len() && counted.is_some();
        fits.then_some(Tensor { storage, offset: self.number(items.get(1))? as usize, shape, strides })
    }
}
