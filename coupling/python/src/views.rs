//! Arrays that lie in memory of the exchange: the only unsafe code of the package.

use crate::peer::Frame;
use numpy::ndarray::{ArrayView1, ArrayView2};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use std::ptr::NonNull;
use std::sync::{Mutex, PoisonError};
use voidage_coupling::protocol::{Column, Layout};
use voidage_coupling::transport::Loan;

/// Memory for an answer; arrays in it have it as their base.
#[pyclass(frozen, module = "voidage")]
pub struct Memory {
    loan: Mutex<Option<Loan>>,
    payload: NonNull<[f64]>,
}

// SAFETY: `payload` points into `loan`, which may be sent. It is read and written by arrays and [`write`] only, under the
// lock of the interpreter.
unsafe impl Send for Memory {}
// SAFETY: as above.
unsafe impl Sync for Memory {}

impl Memory {
    /// Memory for arrays.
    pub fn new(mut loan: Loan) -> Self {
        // The payload stays where it is when the loan moves: in shared memory, or on the heap.
        let payload = NonNull::from(loan.payload_mut());
        Self { loan: Mutex::new(Some(loan)), payload }
    }

    /// Takes the loan away. The caller has seen that no array is left.
    pub fn take(&self) -> Option<Loan> {
        self.loan.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

/// Whether anything but the caller refers to the memory: an array, or an array made from one.
pub fn in_use(memory: &Bound<'_, Memory>) -> bool {
    // SAFETY: the object is alive, and the interpreter is held.
    let references = unsafe { pyo3::ffi::Py_REFCNT(memory.as_ptr()) };
    references > 1
}

/// Works on the payload, if it has not been sent.
pub fn write(memory: &Bound<'_, Memory>, work: impl FnOnce(&mut [f64])) {
    let memory = memory.get();
    let loan = memory.loan.lock().unwrap_or_else(PoisonError::into_inner);
    if loan.is_some() {
        // SAFETY: the loan is there, so the memory is; `work` calls no Python, which could use an array meanwhile.
        work(unsafe { &mut *memory.payload.as_ptr() });
    }
}

/// A read-only array of a column of a frame; it keeps the frame.
pub fn read_only<'py>(frame: &Bound<'py, Frame>, layout: &Layout, column: Column) -> Bound<'py, PyAny> {
    let numbers = &frame.get().payload()[layout.range(column).unwrap_or(0..0)];
    let shape = (numbers.len(), column.width(layout.dimension));
    // SAFETY: the frame is immutable and keeps its payload in place; it is the base of the array, so it outlives it.
    unsafe { array(numbers.as_ptr(), shape, frame.clone().into_any(), false) }
}

/// A writable array of a column of an answer; it keeps the memory.
pub fn writable<'py>(memory: &Bound<'py, Memory>, layout: &Layout, column: Column) -> Bound<'py, PyAny> {
    let range = layout.range(column).unwrap_or(0..0);
    let payload = memory.get().payload;
    assert!(range.end <= payload.len(), "the layout of an answer is that of its memory");
    let shape = (range.len(), column.width(layout.dimension));
    // SAFETY: the range lies in the payload. The loan is taken out of the memory only when nothing but the answer refers
    // to the memory, and the answer forgets it then: while an array has it as its base, the payload stays.
    unsafe { array(payload.cast::<f64>().as_ptr().add(range.start), shape, memory.clone().into_any(), true) }
}

/// # Safety
/// There are as many numbers as `shape` says first, and `base` keeps them where they are. If `writable`, they are not
/// read through references meanwhile.
unsafe fn array<'py>(
    numbers: *const f64,
    (length, width): (usize, usize),
    base: Bound<'py, PyAny>,
    writable: bool,
) -> Bound<'py, PyAny> {
    if width == 1 {
        // SAFETY: the promise of the caller.
        let array =
            unsafe { PyArray1::borrow_from_array(&ArrayView1::from_shape_ptr(length, numbers), base) };
        if !writable {
            drop(array.readwrite().make_nonwriteable());
        }
        return array.into_any();
    }
    let shape = (length / width, width);
    // SAFETY: the promise of the caller.
    let array = unsafe { PyArray2::borrow_from_array(&ArrayView2::from_shape_ptr(shape, numbers), base) };
    if !writable {
        drop(array.readwrite().make_nonwriteable());
    }
    array.into_any()
}
