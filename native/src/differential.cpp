#include "pieper/differential.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace pieper {
namespace {

// A rigid motion, 3x4 row-major.
struct Motion {
  double m[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
};

Motion operator*(const Motion& a, const Motion& b) {
  Motion c;
  for (int r = 0; r < 3; ++r)
    for (int k = 0; k < 4; ++k) {
      double sum = k == 3 ? a.m[4 * r + 3] : 0.0;
      for (int j = 0; j < 3; ++j) sum += a.m[4 * r + j] * b.m[4 * j + k];
      c.m[4 * r + k] = sum;
    }
  return c;
}

void cross(const double* a, const double* b, double* out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

// exp([S] q) of a unit screw, linear part first (Lynch and Park, Modern Robotics, eq. 3.88). A zero-pitch screw turns
// about the point w x v, so the translation is (I - R) (w x v).
Motion exponential(const double* screw, double q) {
  Motion out;
  const double *v = screw, *w = screw + 3;
  if (w[0] == 0 && w[1] == 0 && w[2] == 0) {
    for (int r = 0; r < 3; ++r) out.m[4 * r + 3] = v[r] * q;
    return out;
  }
  const double s = std::sin(q), half = std::sin(0.5 * q), t = 2 * half * half;  // t = 1 - cos q without cancellation
  const double W[9] = {0, -w[2], w[1], w[2], 0, -w[0], -w[1], w[0], 0};
  double point[3];
  cross(w, v, point);
  for (int r = 0; r < 3; ++r) {
    double moved = 0;
    for (int k = 0; k < 3; ++k) {
      const double square = w[r] * w[k] - (r == k ? 1.0 : 0.0);  // W^2 = w w^T - I
      const double change = s * W[3 * r + k] + t * square;
      out.m[4 * r + k] = (r == k ? 1.0 : 0.0) + change;
      moved -= change * point[k];
    }
    out.m[4 * r + 3] = moved;
  }
  return out;
}

double axis_value(const Chain& chain, const double* q, std::size_t axis) {
  if (!chain.coupled()) return q[axis];
  double value = 0;
  for (std::size_t k = 0; k < chain.joints(); ++k) value += chain.coupling(axis)[k] * q[k];
  return value;
}

// The motions of the base after 0, 1, ..., m axes.
std::vector<Motion> products(const Chain& chain, const double* q) {
  std::vector<Motion> out(chain.axes() + 1);
  for (std::size_t i = 0; i < chain.axes(); ++i)
    out[i + 1] = out[i] * exponential(chain.screw(i), axis_value(chain, q, i));
  return out;
}

Motion motion(const double* rows) {
  Motion out;
  std::copy(rows, rows + 12, out.m);
  return out;
}

void write_pose(const Motion& T, double* out) {
  std::copy(T.m, T.m + 12, out);
  out[12] = out[13] = out[14] = 0, out[15] = 1;
}

// Space Jacobian per axis: the screws carried along (Modern Robotics, eq. 5.11), (m, 6) here.
std::vector<double> carried_screws(const Chain& chain, const std::vector<Motion>& T) {
  std::vector<double> out(6 * chain.axes());
  for (std::size_t i = 0; i < chain.axes(); ++i) {
    const double *v = chain.screw(i), *w = v + 3, *m = T[i].m;
    double *vo = &out[6 * i], *wo = vo + 3;
    const double p[3] = {m[3], m[7], m[11]};
    for (int r = 0; r < 3; ++r) {
      wo[r] = m[4 * r] * w[0] + m[4 * r + 1] * w[1] + m[4 * r + 2] * w[2];
      vo[r] = m[4 * r] * v[0] + m[4 * r + 1] * v[1] + m[4 * r + 2] * v[2];
    }
    double moved[3];
    cross(p, wo, moved);
    for (int r = 0; r < 3; ++r) vo[r] += moved[r];
  }
  return out;
}

// Columns of one configuration, (m, 6): linear part then angular, of the given kind.
std::vector<double> axis_columns(const Chain& chain, const double* q, JacobianKind kind) {
  const std::vector<Motion> T = products(chain, q);
  std::vector<double> columns = carried_screws(chain, T);
  if (kind == JacobianKind::space) return columns;
  const Motion tip = T.back() * motion(chain.home());
  const double p[3] = {tip.m[3], tip.m[7], tip.m[11]};
  for (std::size_t i = 0; i < chain.axes(); ++i) {
    double *v = &columns[6 * i], *w = v + 3, moved[3];
    cross(w, p, moved);  // velocity at the tip: v + w x p
    for (int r = 0; r < 3; ++r) v[r] += moved[r];
    if (kind == JacobianKind::body) {
      double body[6];
      for (int r = 0; r < 3; ++r) {
        body[r] = tip.m[r] * v[0] + tip.m[4 + r] * v[1] + tip.m[8 + r] * v[2];
        body[r + 3] = tip.m[r] * w[0] + tip.m[4 + r] * w[1] + tip.m[8 + r] * w[2];
      }
      std::copy(body, body + 6, v);
    }
  }
  return columns;
}

// (m, 6) per axis to 6 x n per joint, row-major.
void write_jacobian(const Chain& chain, const std::vector<double>& columns, double* out) {
  const std::size_t m = chain.axes(), n = chain.joints();
  std::fill(out, out + 6 * n, 0.0);
  for (std::size_t i = 0; i < m; ++i)
    for (std::size_t k = 0; k < n; ++k) {
      const double weight = chain.coupled() ? chain.coupling(i)[k] : (i == k ? 1.0 : 0.0);
      if (weight == 0) continue;
      for (std::size_t r = 0; r < 6; ++r) out[r * n + k] += weight * columns[6 * i + r];
    }
}

// Derivative of column j of the geometric Jacobian by axis value i (Hessian entry). The column of the axis nearer to the
// base turns the other one: with a = min(i, j), b = max(i, j), the linear part is w_a x v_b; the angular part is
// w_i x w_j when i comes first and 0 otherwise.
void column_derivative(const std::vector<double>& columns, std::size_t j, std::size_t i, double* out) {
  const std::size_t first = std::min(i, j), last = std::max(i, j);
  cross(&columns[6 * first + 3], &columns[6 * last], out);
  if (i < j) {
    cross(&columns[6 * i + 3], &columns[6 * j + 3], out + 3);
  } else {
    out[3] = out[4] = out[5] = 0;
  }
}

}  // namespace

void plain_poses(const Chain& chain, const double* q, std::size_t count, double* out) {
  const Motion home = motion(chain.home());
  for (std::size_t k = 0; k < count; ++k)
    write_pose(products(chain, q + k * chain.joints()).back() * home, out + 16 * k);
}

void plain_jacobians(const Chain& chain, const double* q, std::size_t count, JacobianKind kind, double* out) {
  const std::size_t n = chain.joints();
  for (std::size_t k = 0; k < count; ++k) write_jacobian(chain, axis_columns(chain, q + k * n, kind), out + 6 * n * k);
}

void plain_manipulability(const Chain& chain, const double* q, std::size_t count, double* out) {
  const std::size_t n = chain.joints();
  std::vector<double> J(6 * n);
  for (std::size_t k = 0; k < count; ++k) {
    plain_jacobians(chain, q + k * n, 1, JacobianKind::geometric, J.data());
    const std::size_t rank = std::min<std::size_t>(6, n), length = std::max<std::size_t>(6, n);
    double product = 1;
    std::vector<std::vector<double>> rows(rank, std::vector<double>(length));
    for (std::size_t i = 0; i < rank; ++i)
      for (std::size_t c = 0; c < length; ++c) rows[i][c] = n >= 6 ? J[i * n + c] : J[c * n + i];
    for (std::size_t i = 0; i < rank; ++i) {
      double square = 0;
      for (double x : rows[i]) square += x * x;
      product *= std::sqrt(square);
      if (square == 0) break;
      for (std::size_t j = i + 1; j < rank; ++j) {
        double along = 0;
        for (std::size_t c = 0; c < length; ++c) along += rows[i][c] * rows[j][c];
        for (std::size_t c = 0; c < length; ++c) rows[j][c] -= along / square * rows[i][c];
      }
    }
    out[k] = product;
  }
}

void jacobian_rate(const Chain& chain, const double* q, const double* dq, std::size_t count, double* out) {
  const std::size_t m = chain.axes(), n = chain.joints();
  std::vector<double> rate(6 * m);
  for (std::size_t k = 0; k < count; ++k) {
    const std::vector<double> columns = axis_columns(chain, q + k * n, JacobianKind::geometric);
    std::fill(rate.begin(), rate.end(), 0.0);
    for (std::size_t i = 0; i < m; ++i) {
      const double speed = axis_value(chain, dq + k * n, i);
      for (std::size_t j = 0; j < m; ++j) {
        double change[6];
        column_derivative(columns, j, i, change);
        for (std::size_t r = 0; r < 6; ++r) rate[6 * j + r] += speed * change[r];
      }
    }
    write_jacobian(chain, rate, out + 6 * n * k);
  }
}

void hessian(const Chain& chain, const double* q, std::size_t count, double* out) {
  const std::size_t m = chain.axes(), n = chain.joints();
  std::vector<double> by_axis(6 * m), by_joint(6 * n);
  for (std::size_t k = 0; k < count; ++k) {
    const std::vector<double> columns = axis_columns(chain, q + k * n, JacobianKind::geometric);
    double* first = out + 6 * n * n * k;
    std::fill(first, first + 6 * n * n, 0.0);
    for (std::size_t i = 0; i < m; ++i) {
      for (std::size_t j = 0; j < m; ++j) column_derivative(columns, j, i, &by_axis[6 * j]);
      write_jacobian(chain, by_axis, by_joint.data());
      for (std::size_t joint = 0; joint < n; ++joint) {
        const double weight = chain.coupled() ? chain.coupling(i)[joint] : (i == joint ? 1.0 : 0.0);
        if (weight == 0) continue;
        for (std::size_t e = 0; e < 6 * n; ++e) first[6 * n * joint + e] += weight * by_joint[e];
      }
    }
  }
}

void link_poses(const Chain& chain, const std::vector<LinkFrame>& frames, const double* q, std::size_t count,
                double* out) {
  for (std::size_t k = 0; k < count; ++k) {
    const std::vector<Motion> T = products(chain, q + k * chain.joints());
    for (std::size_t f = 0; f < frames.size(); ++f)
      write_pose(T[frames[f].after] * motion(frames[f].home.data()), out + 16 * (k * frames.size() + f));
  }
}

}  // namespace pieper
