//! Eight numbers in single precision at once.
//!
//! Every operation is one of IEEE 754 lane by lane, and a product is fused with a sum where [`Eight::mul_add`] says so and
//! nowhere else. So results are the same bit for bit with vector units and without.

#[cfg(target_arch = "x86_64")]
pub(super) use avx::Avx;
use std::array::from_fn;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Numbers in a [`Lanes`].
pub(super) const LANES: usize = 8;

/// Eight numbers in memory.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(32))]
pub(super) struct Lanes(pub [f32; LANES]);

impl Lanes {
    pub const ZERO: Self = Self([0.0; LANES]);

    /// The sum of all, in double precision.
    pub fn sum(&self) -> f64 {
        let wide = self.0.map(f64::from);
        let [a, b, c, d] = from_fn(|l| wide[l] + wide[l + 4]);
        (a + c) + (b + d)
    }
}

/// Eight numbers in registers.
pub(super) trait Eight:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// What shows that the processor has the registers.
    type Unit: Copy;

    fn load(unit: Self::Unit, from: &Lanes) -> Self;
    fn store(self) -> Lanes;

    /// `self * b + c`, rounded once.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// `c - self * b`, rounded once.
    fn neg_mul_add(self, b: Self, c: Self) -> Self;
    fn sqrt(self) -> Self;
    /// The larger one; `other` where they are equal or no numbers.
    fn max(self, other: Self) -> Self;
    /// The smaller one; `other` where they are equal or no numbers.
    fn min(self, other: Self) -> Self;
    /// `yes` where `self` is above `other`, else `no`.
    fn where_above(self, other: Self, yes: Self, no: Self) -> Self;

    /// Four numbers of each of eight rows, as four times eight.
    fn columns(unit: Self::Unit, rows: [&[f32; 4]; LANES]) -> [Self; 4];
    /// The rows again.
    fn rows(columns: [Self; 4]) -> [[f32; 4]; LANES];

    fn all(unit: Self::Unit, x: f32) -> Self {
        Self::load(unit, &Lanes([x; LANES]))
    }

    fn abs(self) -> Self {
        self.max(-self)
    }
}

/// For any processor.
#[derive(Clone, Copy)]
pub(super) struct Portable(Lanes);

impl Portable {
    fn with(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(Lanes(from_fn(|l| f(self.0.0[l], other.0.0[l]))))
    }
}

impl Add for Portable {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        self.with(other, |a, b| a + b)
    }
}

impl Sub for Portable {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self.with(other, |a, b| a - b)
    }
}

impl Mul for Portable {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        self.with(other, |a, b| a * b)
    }
}

impl Div for Portable {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        self.with(other, |a, b| a / b)
    }
}

impl Neg for Portable {
    type Output = Self;
    fn neg(self) -> Self {
        Self(Lanes(self.0.0.map(|x| -x)))
    }
}

impl Eight for Portable {
    type Unit = ();

    fn load(_: (), from: &Lanes) -> Self {
        Self(*from)
    }

    fn store(self) -> Lanes {
        self.0
    }

    fn mul_add(self, b: Self, c: Self) -> Self {
        Self(Lanes(from_fn(|l| self.0.0[l].mul_add(b.0.0[l], c.0.0[l]))))
    }

    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        (-self).mul_add(b, c)
    }

    fn sqrt(self) -> Self {
        Self(Lanes(self.0.0.map(f32::sqrt)))
    }

    fn max(self, other: Self) -> Self {
        self.with(other, |a, b| if a > b { a } else { b })
    }

    fn min(self, other: Self) -> Self {
        self.with(other, |a, b| if a < b { a } else { b })
    }

    fn where_above(self, other: Self, yes: Self, no: Self) -> Self {
        let choose = |l: usize| if self.0.0[l] > other.0.0[l] { yes.0.0[l] } else { no.0.0[l] };
        Self(Lanes(from_fn(choose)))
    }

    fn columns(_: (), rows: [&[f32; 4]; LANES]) -> [Self; 4] {
        from_fn(|a| Self(Lanes(rows.map(|row| row[a]))))
    }

    fn rows(columns: [Self; 4]) -> [[f32; 4]; LANES] {
        from_fn(|l| columns.map(|column| column.0.0[l]))
    }
}

/// The vector units of x86-64 since 2013.
#[cfg(target_arch = "x86_64")]
mod avx {
    use super::{Eight, LANES, Lanes};
    use pulp::cast;
    use pulp::x86::V3;
    use std::arch::x86_64::{__m128, __m256, _CMP_GT_OQ};
    use std::array::from_fn;
    use std::ops::{Add, Div, Mul, Neg, Sub};

    /// A register, and what shows that there is one.
    #[derive(Clone, Copy)]
    pub(in crate::solver) struct Avx(V3, __m256);

    impl Add for Avx {
        type Output = Self;
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            Self(self.0, self.0.avx._mm256_add_ps(self.1, other.1))
        }
    }

    impl Sub for Avx {
        type Output = Self;
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            Self(self.0, self.0.avx._mm256_sub_ps(self.1, other.1))
        }
    }

    impl Mul for Avx {
        type Output = Self;
        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            Self(self.0, self.0.avx._mm256_mul_ps(self.1, other.1))
        }
    }

    impl Div for Avx {
        type Output = Self;
        #[inline(always)]
        fn div(self, other: Self) -> Self {
            Self(self.0, self.0.avx._mm256_div_ps(self.1, other.1))
        }
    }

    impl Neg for Avx {
        type Output = Self;
        #[inline(always)]
        fn neg(self) -> Self {
            let sign = self.0.avx._mm256_set1_ps(-0.0);
            Self(self.0, self.0.avx._mm256_xor_ps(self.1, sign))
        }
    }

    impl Eight for Avx {
        type Unit = V3;

        #[inline(always)]
        fn load(unit: V3, from: &Lanes) -> Self {
            Self(unit, cast(from.0))
        }

        #[inline(always)]
        fn store(self) -> Lanes {
            Lanes(cast(self.1))
        }

        #[inline(always)]
        fn mul_add(self, b: Self, c: Self) -> Self {
            Self(self.0, self.0.fma._mm256_fmadd_ps(self.1, b.1, c.1))
        }

        #[inline(always)]
        fn neg_mul_add(self, b: Self, c: Self) -> Self {
            Self(self.0, self.0.fma._mm256_fnmadd_ps(self.1, b.1, c.1))
        }

        #[inline(always)]
        fn sqrt(self) -> Self {
            Self(self.0, self.0.avx._mm256_sqrt_ps(self.1))
        }

        #[inline(always)]
        fn max(self, other: Self) -> Self {
            Self(self.0, self.0.avx._mm256_max_ps(self.1, other.1))
        }

        #[inline(always)]
        fn min(self, other: Self) -> Self {
            Self(self.0, self.0.avx._mm256_min_ps(self.1, other.1))
        }

        #[inline(always)]
        fn where_above(self, other: Self, yes: Self, no: Self) -> Self {
            let above = self.0.avx._mm256_cmp_ps::<_CMP_GT_OQ>(self.1, other.1);
            Self(self.0, self.0.avx._mm256_blendv_ps(no.1, yes.1, above))
        }

        #[inline(always)]
        fn columns(unit: V3, rows: [&[f32; 4]; LANES]) -> [Self; 4] {
            let pair = |l: usize| {
                let [low, high]: [__m128; 2] = [cast(*rows[l]), cast(*rows[l + 4])];
                unit.avx._mm256_insertf128_ps::<1>(unit.avx._mm256_castps128_ps256(low), high)
            };
            transposed(unit, from_fn(pair)).map(|x| Self(unit, x))
        }

        #[inline(always)]
        fn rows(columns: [Self; 4]) -> [[f32; 4]; LANES] {
            let unit = columns[0].0;
            let pairs = transposed(unit, columns.map(|x| x.1));
            from_fn(|l| match l {
                0..4 => cast(unit.avx._mm256_castps256_ps128(pairs[l])),
                _ => cast(unit.avx._mm256_extractf128_ps::<1>(pairs[l - 4])),
            })
        }
    }

    /// Four by four numbers with rows and columns exchanged, in both halves.
    #[inline(always)]
    fn transposed(unit: V3, [a, b, c, d]: [__m256; 4]) -> [__m256; 4] {
        let avx = unit.avx;
        let [low, high] = [avx._mm256_unpacklo_ps(a, b), avx._mm256_unpackhi_ps(a, b)];
        let [later_low, later_high] = [avx._mm256_unpacklo_ps(c, d), avx._mm256_unpackhi_ps(c, d)];
        [
            avx._mm256_shuffle_ps::<0x44>(low, later_low),
            avx._mm256_shuffle_ps::<0xEE>(low, later_low),
            avx._mm256_shuffle_ps::<0x44>(high, later_high),
            avx._mm256_shuffle_ps::<0xEE>(high, later_high),
        ]
    }
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use super::*;
    use pulp::x86::V3;

    /// All operations on some numbers, one after the other.
    fn results<E: Eight>(unit: E::Unit, [a, b, c]: [Lanes; 3]) -> Vec<Lanes> {
        let [a, b, c] = [a, b, c].map(|x| E::load(unit, &x));
        let rows = E::rows([a, b, c, a]);
        let mut all =
            vec![a + b, a - b, a * b, a / b, -a, a.mul_add(b, c), a.neg_mul_add(b, c), a.abs().sqrt()];
        all.extend([a.max(b), a.min(b), a.where_above(b, b, c), E::all(unit, 0.1)]);
        all.extend(E::columns(unit, rows.each_ref()));
        all.into_iter().map(E::store).collect()
    }

    #[test]
    fn vector_units_give_the_same_bits() {
        let Some(unit) = V3::try_new() else { return };
        let some =
            |k: i32| Lanes(from_fn(|l| (0.37 + l as f32).powi(k) * if l % 3 == 0 { -1.0 } else { 1.0 }));
        let odd = Lanes([0.0, -0.0, f32::INFINITY, f32::NAN, 1e-42, 1e38, -1e38, 1.0]);
        for numbers in [[some(1), some(3), some(-2)], [odd, some(1), odd], [some(2), odd, some(1)]] {
            let bits = |all: Vec<Lanes>| -> Vec<u32> {
                // What is no number has any bits.
                let bits = |x: f32| if x.is_nan() { u32::MAX } else { x.to_bits() };
                all.iter().flat_map(|x| x.0.map(bits)).collect()
            };
            assert_eq!(bits(results::<Avx>(unit, numbers)), bits(results::<Portable>((), numbers)));
        }
    }
}
