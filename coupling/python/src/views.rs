//! Arrays that lie in memory of the exchange: the only unsafe code of the package.

use crate::peer::Frame;
use numpy::ndarray::{ArrayView1, ArrayView2};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use std::ops::Range;

/// A read-only array of a part of the payload of a frame, `width` numbers per row; it keeps the frame.
pub fn read_only<'py>(frame: &Bound<'py, Frame>, range: Range<usize>, width: usize) -> Bound<'py, PyAny> {
    let (numbers, base) = (&frame.get().payload()[range], frame.clone().into_any());
    if width == 1 {
        let view = ArrayView1::from(numbers);
        // SAFETY: the frame is immutable and keeps its payload in place; it is the base of the array, so it outlives
        // it.
        let array = unsafe { PyArray1::borrow_from_array(&view, base) };
        drop(array.readwrite().make_nonwriteable());
        return array.into_any();
    }
    let rows = numbers.len() / width;
    // SAFETY: there are so many numbers, and the slice lives as long as the frame does.
    let view = unsafe { ArrayView2::from_shape_ptr((rows, width), numbers.as_ptr()) };
    // SAFETY: as above.
    let array = unsafe { PyArray2::borrow_from_array(&view, base) };
    drop(array.readwrite().make_nonwriteable());
    array.into_any()
}
