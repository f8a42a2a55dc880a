// Forward kinematics of one arm, the UR5e, written out by hand.
//
// The yardstick for a general kernel: this one knows the arm. Joints 2, 3 and 4 are parallel, so their angles are
// added before the sine is taken; every twist is a quarter turn and costs nothing; the fixed turn of half a circle
// at the base is a change of sign. Eight configurations are worked on at once, one in each lane.
//
// Lengths are the published Denavit-Hartenberg parameters. With u = (cos q1, sin q1, 0), w = (sin q1, -cos q1, 0)
// and k = (0, 0, 1) the arm moves in the plane of u and k and is pushed out of it along w:
//
//     x4 = cos(t) u + sin(t) k,  z4 = sin(t) u - cos(t) k,  t = q2 + q3 + q4
//     z5 = -sin(q5) x4 + cos(q5) w
//     p  = d1 k + a2 (cos(q2) u + sin(q2) k) + a3 (cos(q2 + q3) u + sin(q2 + q3) k) + d4 w + d5 z4 + d6 z5
//
// That is the nominal arm. The published URDF prints a quarter turn as 1.570796327, so its axes are off by 2e-10 rad.
// The literal kernel computes exactly that: the cosines of the printed angles stay in the formulas, their sines are 1
// to the last bit. Joints 2, 3 and 4 are parallel in both. Both keep the offsets of 2e-11 m that the URDF carries along
// axes 4 and 5, as part of d4 and d5.
//
// Built by benchmarks/forward_kinematics.py, called through ctypes.

#include <cstdint>
#include <cstring>
#if defined(__AVX512F__)
#include <immintrin.h>
#endif

namespace {

using Lanes = double __attribute__((vector_size(64)));
using Integers = std::int64_t __attribute__((vector_size(64)));

constexpr double e5 = -2.044881182297852e-11, e6 = -2.042830148012698e-11;
constexpr double d1 = 0.1625, a2 = -0.425, a3 = -0.3922, d4 = 0.1333 + e5, d5 = 0.0997 + e6, d6 = 0.0996;

// Of the printed angles: cos(1.570796327), twice, and cos(1.570796326589793) behind half a turn.
constexpr double ca = -2.0510342851533115e-10, cb = -2.0510355098001109e-10;

Lanes all(double value) { return Lanes{} + value; }

// Two registers hold 16 numbers; pick eight of them.
#define PICK(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)

// sin and cos of every lane: reduction to a quarter turn after Cody and Waite, then polynomials. By default what this
// arm needs: two parts of pi/2 and the minimax polynomials of fdlibm, good to about one unit in the last place within a
// few turns. With CAREFUL_SINE what the package does: what rounding took from the reduced angle is caught in e and put
// back, good to less than one unit up to 1e6 rad; its coefficients are those of native/src/simd/sincos.hpp.
inline void sincos(Lanes angle, Lanes& sine, Lanes& cosine) {
  const Lanes shift = all(6755399441055744.0);  // 1.5 * 2^52: adding it rounds to an integer
  const Lanes shifted = angle * 0.6366197723675814 + shift;
  const Lanes turns = shifted - shift;
  const Integers quadrant = (Integers)shifted;
  const Lanes coarse = angle - turns * 1.5707963267948966;
#if defined(CAREFUL_SINE)
  const Lanes r = coarse - turns * 0x1.1a626331p-54;
  const Lanes e = ((coarse - r) - turns * 0x1.1a626331p-54) - turns * 0x1.1701b839a252p-88;
  const Lanes z = r * r + r * (e + e);
  const Lanes p =
      ((((z * 0x1.5d8fa7fd5c9d2p-33 - 0x1.ae5e594b78a4cp-26) * z + 0x1.71de3564d2b7bp-19) * z - 0x1.a01a019bf7efap-13) *
           z +
       0x1.111111110f77dp-7) *
          z -
      0x1.5555555555548p-3;
  const Lanes q = ((((z * -0x1.8fa9952065738p-37 + 0x1.1ee9e15f38979p-29) * z - 0x1.27e4f7f8eae3ap-22) * z +
                    0x1.a01a019c97777p-16) *
                       z -
                   0x1.6c16c16c1504bp-10) *
                      z +
                  0x1.555555555554bp-5;
  const Lanes sin_r = r + (r * z * p + e);
  const Lanes cos_r = 1.0 + z * (z * q - 0.5);
#else
  const Lanes r = coarse - turns * 6.123233995736766e-17;
  const Lanes z = r * r;
  const Lanes s =
      ((((z * 1.58969099521155010221e-10 - 2.50507602534068634195e-08) * z + 2.75573137070700676789e-06) * z -
        1.98412698298579493134e-04) *
           z +
       8.33333333332248946124e-03) *
          z -
      1.66666666666666324348e-01;
  const Lanes c =
      ((((z * -1.13596475577881948265e-11 + 2.08757232129817482790e-09) * z - 2.75573143513906633035e-07) * z +
        2.48015872894767294178e-05) *
           z -
       1.38888888888741095749e-03) *
          z +
      4.16666666666666019037e-02;
  const Lanes sin_r = r + r * (z * s);
  const Lanes cos_r = (1.0 - 0.5 * z) + (z * z) * c;
#endif

  const Integers odd = (quadrant & 1) != 0;
  const Integers sine_sign = (quadrant & 2) << 62;
  const Integers cosine_sign = ((quadrant + 1) & 2) << 62;
  sine = (Lanes)((Integers)(odd ? cos_r : sin_r) ^ sine_sign);
  cosine = (Lanes)((Integers)(odd ? sin_r : cos_r) ^ cosine_sign);
}

// Eight rows of six joints to six columns. Lane order is 0 4 1 5 2 6 3 7.
inline void load(const double* q, Lanes (&joint)[6]) {
  Lanes row[6];
  std::memcpy(row, q, sizeof row);
  const Lanes x01 = PICK(row[0], row[1], 0, 1, 6, 7, 12, 13, 12, 13),
              y01 = PICK(row[3], row[4], 0, 1, 6, 7, 12, 13, 12, 13);
  const Lanes x23 = PICK(row[0], row[1], 2, 3, 8, 9, 14, 15, 14, 15),
              y23 = PICK(row[3], row[4], 2, 3, 8, 9, 14, 15, 14, 15);
  const Lanes x45 = PICK(row[0], row[1], 4, 5, 10, 11, 10, 11, 10, 11),
              y45 = PICK(row[3], row[4], 4, 5, 10, 11, 10, 11, 10, 11);
  const Lanes a01 = PICK(x01, row[2], 0, 1, 2, 3, 4, 5, 10, 11), b01 = PICK(y01, row[5], 0, 1, 2, 3, 4, 5, 10, 11);
  const Lanes a23 = PICK(x23, row[2], 0, 1, 2, 3, 4, 5, 12, 13), b23 = PICK(y23, row[5], 0, 1, 2, 3, 4, 5, 12, 13);
  const Lanes a45 = PICK(x45, row[2], 0, 1, 2, 3, 8, 9, 14, 15), b45 = PICK(y45, row[5], 0, 1, 2, 3, 8, 9, 14, 15);
  joint[0] = PICK(a01, b01, 0, 8, 2, 10, 4, 12, 6, 14);
  joint[1] = PICK(a01, b01, 1, 9, 3, 11, 5, 13, 7, 15);
  joint[2] = PICK(a23, b23, 0, 8, 2, 10, 4, 12, 6, 14);
  joint[3] = PICK(a23, b23, 1, 9, 3, 11, 5, 13, 7, 15);
  joint[4] = PICK(a45, b45, 0, 8, 2, 10, 4, 12, 6, 14);
  joint[5] = PICK(a45, b45, 1, 9, 3, 11, 5, 13, 7, 15);
}

template <bool around_cache>
inline void put(double* address, Lanes value) {
#if defined(__AVX512F__)
  if constexpr (around_cache) {
    _mm512_stream_pd(address, (__m512d)value);
    return;
  }
#endif
  std::memcpy(address, &value, sizeof value);
}

// Columns of the first three rows (m[row][column]) to eight 4x4 matrices, rows of four one after the other.
template <bool around_cache>
inline void store(double* T, const Lanes (&m)[3][4]) {
  // Pairs of neighbours: even lanes are poses 0 1 2 3, odd lanes 4 5 6 7.
  Lanes pair[2][6];
  for (int row = 0; row < 3; ++row) {
    for (int side = 0; side < 2; ++side) {
      pair[0][2 * row + side] = PICK(m[row][2 * side], m[row][2 * side + 1], 0, 8, 2, 10, 4, 12, 6, 14);
      pair[1][2 * row + side] = PICK(m[row][2 * side], m[row][2 * side + 1], 1, 9, 3, 11, 5, 13, 7, 15);
    }
  }
  const Lanes last = {0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
  for (int half = 0; half < 2; ++half) {
    const Lanes(&p)[6] = pair[half];
    double* out = T + 64 * half;
    // Rows of poses 0 and 1, then of 2 and 3 (of this half).
    const Lanes top01 = PICK(p[0], p[1], 0, 1, 8, 9, 2, 3, 10, 11),
                top23 = PICK(p[0], p[1], 4, 5, 12, 13, 6, 7, 14, 15);
    const Lanes mid01 = PICK(p[2], p[3], 0, 1, 8, 9, 2, 3, 10, 11),
                mid23 = PICK(p[2], p[3], 4, 5, 12, 13, 6, 7, 14, 15);
    const Lanes low01 = PICK(p[4], p[5], 0, 1, 8, 9, 2, 3, 10, 11),
                low23 = PICK(p[4], p[5], 4, 5, 12, 13, 6, 7, 14, 15);
    put<around_cache>(out, PICK(top01, mid01, 0, 1, 2, 3, 8, 9, 10, 11));
    put<around_cache>(out + 8, PICK(low01, last, 0, 1, 2, 3, 8, 9, 10, 11));
    put<around_cache>(out + 16, PICK(top01, mid01, 4, 5, 6, 7, 12, 13, 14, 15));
    put<around_cache>(out + 24, PICK(low01, last, 4, 5, 6, 7, 12, 13, 14, 15));
    put<around_cache>(out + 32, PICK(top23, mid23, 0, 1, 2, 3, 8, 9, 10, 11));
    put<around_cache>(out + 40, PICK(low23, last, 0, 1, 2, 3, 8, 9, 10, 11));
    put<around_cache>(out + 48, PICK(top23, mid23, 4, 5, 6, 7, 12, 13, 14, 15));
    put<around_cache>(out + 56, PICK(low23, last, 4, 5, 6, 7, 12, 13, 14, 15));
  }
}

// Sines and cosines that the formulas need: of joints 1, 2, 2+3, 2+3+4, 5 and 6.
struct Turns {
  Lanes s1, c1, s2, c2, s23, c23, s, c, s5, c5, s6, c6;

  explicit Turns(const Lanes (&joint)[6]) {
    const Lanes q23 = joint[1] + joint[2];
    sincos(joint[0], s1, c1);
    sincos(joint[1], s2, c2);
    sincos(q23, s23, c23);
    sincos(q23 + joint[3], s, c);
    sincos(joint[4], s5, c5);
    sincos(joint[5], s6, c6);
  }
};

// First three rows of the pose, m[row][column].
inline void nominal(const Turns& t, Lanes (&m)[3][4]) {
  // Columns x, y, z, p in the moving triad (u, w, k).
  const Lanes cc5 = t.c * t.c5, sc5 = t.s * t.c5, reach = d6 * t.s5;
  const Lanes column[4][3] = {
      {t.c6 * cc5 - t.s6 * t.s, t.c6 * t.s5, t.c6 * sc5 + t.s6 * t.c},
      {-t.s6 * cc5 - t.c6 * t.s, -t.s6 * t.s5, t.c6 * t.c - t.s6 * sc5},
      {-t.s5 * t.c, t.c5, -t.s5 * t.s},
      {a2 * t.c2 + a3 * t.c23 + d5 * t.s - reach * t.c, d4 + d6 * t.c5,
       d1 + a2 * t.s2 + a3 * t.s23 - d5 * t.c - reach * t.s},
  };
  // To base axes; the base link is turned by half a circle about k.
  for (int i = 0; i < 4; ++i) {
    m[0][i] = -t.c1 * column[i][0] - t.s1 * column[i][1];
    m[1][i] = t.c1 * column[i][1] - t.s1 * column[i][0];
    m[2][i] = column[i][2];
  }
}

// The same with the printed angles, in the triad u, K = ca n + k, W = ca k - n with n = (-sin q1, cos q1, 0).
inline void literal(const Turns& t, Lanes (&m)[3][4]) {
  const Lanes x5[3] = {t.c5 * t.c - (ca * t.s5) * t.s, t.c5 * t.s + (ca * t.s5) * t.c, t.s5};
  const Lanes y5[3] = {-t.s5 * t.c - (ca * t.c5) * t.s, (ca * t.c5) * t.c - t.s5 * t.s, t.c5};
  const Lanes z5[3] = {t.s, -t.c, all(ca)};
  Lanes column[4][3];
  for (int i = 0; i < 3; ++i) {
    const Lanes turned = cb * y5[i] - z5[i];
    column[0][i] = t.c6 * x5[i] + t.s6 * turned;
    column[1][i] = t.c6 * turned - t.s6 * x5[i];
    column[2][i] = y5[i] + cb * z5[i];
  }
  column[3][0] = a2 * t.c2 + a3 * t.c23 + d5 * t.s + d6 * y5[0];
  column[3][1] = a2 * t.s2 + a3 * t.s23 - d5 * t.c + d6 * y5[1];
  column[3][2] = (d4 + e6 * ca) + d6 * t.c5;
  for (int i = 0; i < 4; ++i) {
    const Lanes along = ca * column[i][1] - column[i][2];
    m[0][i] = t.s1 * along - t.c1 * column[i][0];
    m[1][i] = -t.s1 * column[i][0] - t.c1 * along;
    m[2][i] = column[i][1] + ca * column[i][2];
  }
  m[2][3] += d1;
}

template <bool as_printed, bool around_cache>
inline void eight(const double* q, double* T) {
  Lanes joint[6], m[3][4];
  load(q, joint);
  const Turns turns(joint);
  if constexpr (as_printed)
    literal(turns, m);
  else
    nominal(turns, m);
  store<around_cache>(T, m);
}

template <bool as_printed, bool around_cache>
void many(const double* q, std::int64_t count, double* T) {
  std::int64_t i = 0;
  for (; i + 8 <= count; i += 8) eight<as_printed, around_cache>(q + 6 * i, T + 16 * i);
  if (i < count) {  // the rest, in a padded copy
    double padded_q[48] = {}, padded_T[128] __attribute__((aligned(64)));
    std::memcpy(padded_q, q + 6 * i, sizeof(double) * 6 * (count - i));
    eight<as_printed, false>(padded_q, padded_T);
    std::memcpy(T + 16 * i, padded_T, sizeof(double) * 16 * (count - i));
  }
#if defined(__AVX512F__)
  if constexpr (around_cache) _mm_sfence();
#endif
}

template <bool as_printed>
void forward(const double* q, std::int64_t count, double* T, int around_cache) {
  if (around_cache != 0 && reinterpret_cast<std::uintptr_t>(T) % 64 == 0)
    many<as_printed, true>(q, count, T);
  else
    many<as_printed, false>(q, count, T);
}

}  // namespace

// q: count rows of 6 joints [rad]; T: count matrices of 4 x 4, row by row. around_cache != 0 writes past the caches
// and needs T aligned to 64 bytes.
extern "C" void ur5e_nominal(const double* q, std::int64_t count, double* T, int around_cache) {
  forward<false>(q, count, T, around_cache);
}

extern "C" void ur5e_literal(const double* q, std::int64_t count, double* T, int around_cache) {
  forward<true>(q, count, T, around_cache);
}
