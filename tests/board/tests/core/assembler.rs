//! Assembles a program and creates a board with it.

use emulated_board::{Board, Chip};
use object::{Object, ObjectSection, ObjectSymbol};
use std::process::Command;

/// Address of the first instruction, after the vector table.
const CODE: u32 = 0x0800_0200;
const STACK_TOP: u32 = 0x2000_8000;
/// Exception numbers of the handlers, by label.
const VECTORS: [(&str, usize); 7] = [
    ("reset", 1),
    ("hard_fault", 3),
    ("bus_fault", 5),
    ("sys_tick", 15),
    ("irq0", 16),
    ("irq1", 17),
    ("irq2", 18),
];
/// `const r0, 0x12345678` needs no literal pool and therefore no linker.
const PRELUDE: &str = ".syntax unified
.thumb
.fpu fpv4-sp-d16
.macro const register, value
    movw \\register, #((\\value) & 0xffff)
    movt \\register, #((\\value) >> 16)
.endm
";

/// A board that runs `program`, starting at its label `reset`.
pub fn board(program: &str) -> Board {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (source, target) = (folder.path().join("a.s"), folder.path().join("a.o"));
    std::fs::write(&source, format!("{PRELUDE}{program}\n")).expect("room for a file");
    let status = Command::new("clang")
        .args([
            "--target=thumbv7em-none-eabihf",
            "-mcpu=cortex-m4",
            "-c",
            "-o",
        ])
        .args([&target, &source])
        .status()
        .expect("clang");
    assert!(status.success(), "{program}");
    let data = std::fs::read(&target).expect("clang's output");
    let file = object::File::parse(&*data).expect("an object file");
    let text = file.section_by_name(".text").expect("code");
    let code = text.data().expect("bytes");
    assert_eq!(text.relocations().count(), 0, "relocations need a linker");
    let mut cells = vec![0xff; CODE as usize & 0xffff];
    let mut vector = |number: usize, value: u32| {
        cells[4 * number..4 * number + 4].copy_from_slice(&value.to_le_bytes());
    };
    vector(0, STACK_TOP);
    for (label, number) in VECTORS {
        if let Some(symbol) = file.symbols().find(|s| s.name() == Ok(label)) {
            vector(number, (CODE + symbol.address() as u32) | 1);
        }
    }
    cells.extend(code);
    Board::from_flash(cells, Chip::default())
}
