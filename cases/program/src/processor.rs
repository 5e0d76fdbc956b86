//! Processors that lack what the program is compiled for: it says so, where it would die of an illegal instruction.
//!
//! Code of this program may have any of those instructions anywhere, `main` included. So what looks at the processor is
//! written in assembly, and the loader calls it before all other code of the program (or of the Python package, which
//! has it from here).
#![cfg(all(target_arch = "x86_64", target_os = "linux", target_feature = "avx2"))]

use std::arch::naked_asm;

const MESSAGE: &str = "voidage: this processor lacks AVX2, FMA, BMI2, F16C, LZCNT or MOVBE, which this build needs\n  \
    help: use a processor that has them (Intel since 2013, AMD since 2015)\n";

#[used]
#[unsafe(link_section = ".init_array")]
static LOOK: extern "C" fn() = look;

/// FMA, MOVBE, OSXSAVE, AVX and F16C: register ecx of leaf 1.
const LEAF_1: u32 = 1 << 12 | 1 << 22 | 1 << 27 | 1 << 28 | 1 << 29;
/// BMI1, AVX2 and BMI2: register ebx of leaf 7.
const LEAF_7: u32 = 1 << 3 | 1 << 5 | 1 << 8;
/// LZCNT: register ecx of leaf 0x8000_0001.
const EXTENDED: u32 = 1 << 5;
/// The system keeps the registers of SSE and AVX: register 0 of xgetbv.
const KEPT: u32 = 0b110;

#[unsafe(naked)]
extern "C" fn look() {
    naked_asm!(
        "push rbx",
        // The largest leaf that there is.
        "xor eax, eax",
        "cpuid",
        "cmp eax, 7",
        "jb 2f",
        "mov eax, 1",
        "xor ecx, ecx",
        "cpuid",
        "and ecx, {leaf_1}",
        "cmp ecx, {leaf_1}",
        "jne 2f",
        "xor ecx, ecx",
        "xgetbv",
        "and eax, {kept}",
        "cmp eax, {kept}",
        "jne 2f",
        "mov eax, 7",
        "xor ecx, ecx",
        "cpuid",
        "and ebx, {leaf_7}",
        "cmp ebx, {leaf_7}",
        "jne 2f",
        "mov eax, 0x80000001",
        "xor ecx, ecx",
        "cpuid",
        "test ecx, {extended}",
        "jz 2f",
        "pop rbx",
        "ret",
        // write(2, message, its length); exit_group(1)
        "2:",
        "mov eax, 1",
        "mov edi, 2",
        "lea rsi, [rip + {message}]",
        "mov edx, {length}",
        "syscall",
        "mov eax, 231",
        "mov edi, 1",
        "syscall",
        "ud2",
        leaf_1 = const LEAF_1,
        leaf_7 = const LEAF_7,
        extended = const EXTENDED,
        kept = const KEPT,
        message = sym TEXT,
        length = const MESSAGE.len(),
    )
}

static TEXT: [u8; MESSAGE.len()] = {
    let (mut text, mut at) = ([0; MESSAGE.len()], 0);
    while at < text.len() {
        text[at] = MESSAGE.as_bytes()[at];
        at += 1;
    }
    text
};
