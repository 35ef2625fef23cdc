// SPDX-License-Identifier: Apache-2.0
#include "drivers/sim/scene/contact/layer.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

#include "drivers/sim/scene/math/portable.hpp"

namespace holdfast::scene {
namespace {

using std::numbers::pi;

// From here on exp(-2K) K^2 is below a double's resolution of the compliance.
constexpr double kThick = 20.0;

// The tables' grid, in thicknesses: a = 0 .. 4 and r = 0 .. 12 in steps of 1/8, and what interpolation needs beyond.
constexpr double kStepsPerThickness = 8.0;
constexpr std::size_t kRowStencil = 6;
constexpr std::size_t kColumnStencil = 4;
constexpr std::size_t kLastRow = 32;
constexpr std::size_t kRows = kLastRow + 4;
constexpr std::size_t kLastColumn = 96;
constexpr std::size_t kColumns = kLastColumn + 4;  // B-spline coefficients -1 .. 98
// A spline's end condition dies off by 0.27 a node: 8 nodes beyond the table hide it.
constexpr std::size_t kNodes = kLastColumn + 9;

// Quadrature over K: panels of 1/2 with 8 points carry cos(16 K) to 1e-8; the kernels end at K = 14 (1e-9).
constexpr int kPanels = 28;
constexpr double kPanelWidth = 0.5;

struct Node {
  double at;
  double weight;
};

// Gauss-Legendre, 8 points on [0, 1].
constexpr std::array<Node, 8> kGauss{{{0.019855071751231884, 0.05061426814518813},
                                      {0.10166676129318663, 0.11119051722668724},
                                      {0.2372337950418355, 0.15685332293894363},
                                      {0.4082826787521751, 0.18134189168918100},
                                      {0.5917173212478249, 0.18134189168918100},
                                      {0.7627662049581645, 0.15685332293894363},
                                      {0.8983332387068134, 0.11119051722668724},
                                      {0.9801449282487681, 0.05061426814518813}}};

double sinh_of(double x) {
  const double e = portable::expm1(x);
  return 0.5 * (e + e / (1.0 + e));
}

// sinh x - x without cancellation, x >= 0.
double sinh_excess(double x) {
  if (x >= 1.0) return sinh_of(x) - x;
  const double x2 = x * x;
  double sum = 1.0;
  for (const double divisor : {342.0, 272.0, 210.0, 156.0, 110.0, 72.0, 42.0, 20.0}) sum = 1.0 + x2 / divisor * sum;
  return x * x2 / 6.0 * sum;
}

// layer_compliance in units of h / G, K < kThick. cosh 2K = 1 + 2 sinh^2 K keeps every sum free of cancellation, and
// sinh x / x = 1 + excess / x free of 0 / 0.
LayerCompliance compliance_per_thickness(double nu, double kh) {
  const double e1 = kh > 0.0 ? sinh_excess(kh) / kh : 0.0;
  const double e2 = kh > 0.0 ? sinh_excess(2.0 * kh) / (2.0 * kh) : 0.0;
  const double sinh_2 = kh * kh * (1.0 + e1) * (1.0 + e1);
  const double c = 3.0 - 4.0 * nu;
  const double half_d = 4.0 * (1.0 - nu) * (1.0 - nu) + c * sinh_2 + kh * kh;
  const double cc = c * (1.0 - 2.0 * nu);
  return {
      (1.0 - nu) * (c * (1.0 + e2) + 1.0) / half_d,
      (1.0 + e1) / std::sqrt(1.0 + sinh_2),
      (1.0 - nu) * (2.0 - 4.0 * nu + c * e2) / half_d,
      // (cc sinh^2 K - K^2) / (2 K half_d)
      0.5 * kh * (2.0 * (1.0 - nu) * (1.0 - 4.0 * nu) + cc * e1 * (2.0 + e1)) / half_d,
  };
}

// The half-space's, in units of 1 / (G k).
LayerCompliance half_space_compliance(double nu) {
  return {1.0 - nu, 1.0, 1.0 - nu, 0.5 * (1.0 - 2.0 * nu)};
}

// Layer minus half-space in units of 1 / (G k): analytic, and gone as K^2 exp(-2K).
LayerCompliance difference(double nu, double kh) {
  const LayerCompliance layer = compliance_per_thickness(nu, kh);
  const LayerCompliance half = half_space_compliance(nu);
  return {kh * layer.along - half.along, kh * layer.across - half.across, kh * layer.normal - half.normal,
          kh * layer.coupling - half.coupling};
}

using Bessel = std::array<double, 3>;

// J0, J1, J2 of x >= 0, to 1e-10: power series up to 12, Hankel's asymptotic series from there.
Bessel bessel(double x) {
  constexpr int kTerms = 32;
  static constexpr auto kInverse = [] {
    std::array<double, kTerms + 3> inverse{};
    for (int m = 1; m < kTerms + 3; ++m) inverse[static_cast<std::size_t>(m)] = 1.0 / m;
    return inverse;
  }();
  if (x < 12.0) {
    const double q = 0.25 * x * x;
    double term = 1.0;
    double j0 = 1.0;
    double j1 = 1.0;
    double j2 = 0.5;
    for (std::size_t m = 1; m <= kTerms; ++m) {
      term *= -q * kInverse[m] * kInverse[m];
      j0 += term;
      j1 += term * kInverse[m + 1];
      j2 += term * kInverse[m + 1] * kInverse[m + 2];
      if (std::abs(term) < 1e-17) break;
    }
    return {j0, 0.5 * x * j1, q * j2};
  }
  // a_k = a_{k-1} (4 n^2 - (2k-1)^2) / 8k; P and Q take every other one with alternating signs.
  struct Series {
    std::array<double, 8> p{};
    std::array<double, 8> q{};
  };
  static constexpr auto kSeries = [] {
    std::array<Series, 2> series{};
    for (int n = 0; n < 2; ++n) {
      double a = 1.0;
      for (int k = 0; k < 16; ++k) {
        if (k > 0) a *= (4.0 * n * n - (2.0 * k - 1.0) * (2.0 * k - 1.0)) / (8.0 * k);
        const double sign = k % 4 < 2 ? 1.0 : -1.0;
        Series& s = series[static_cast<std::size_t>(n)];
        (k % 2 == 0 ? s.p : s.q)[static_cast<std::size_t>(k / 2)] = sign * a;
      }
    }
    return series;
  }();
  const double over = 1.0 / x;
  const double over2 = over * over;
  const auto sum = [over2](const std::array<double, 8>& c) {
    double value = 0.0;
    for (std::size_t i = c.size(); i-- > 0;) value = value * over2 + c[i];
    return value;
  };
  const double sine = portable::sin(x);
  const double cosine = portable::cos(x);
  const double scale = std::sqrt(over / pi);  // sqrt(2 / pi x) / sqrt(2)
  const double j0 = scale * (sum(kSeries[0].p) * (sine + cosine) - sum(kSeries[0].q) * over * (sine - cosine));
  const double j1 = scale * (sum(kSeries[1].p) * (sine - cosine) + sum(kSeries[1].q) * over * (sine + cosine));
  return {j0, j1, 2.0 * over * j1 - j0};
}

// Hankel transforms of a dome and of a punch over the force, x = k a: 3 j1(x) / x and sin x / x.
double dome_transform(double x) {
  const double x2 = x * x;
  if (x2 < 0.25) return 1.0 - x2 / 10.0 * (1.0 - x2 / 28.0 * (1.0 - x2 / 54.0 * (1.0 - x2 / 88.0)));
  return 3.0 * (portable::sin(x) - x * portable::cos(x)) / (x * x2);
}

double punch_transform(double x) {
  return x > 0.0 ? portable::sin(x) / x : 1.0;
}

std::vector<Node> wavenumbers() {
  std::vector<Node> nodes;
  nodes.reserve(kPanels * kGauss.size());
  for (int panel = 0; panel < kPanels; ++panel) {
    for (const Node& g : kGauss) nodes.push_back({(panel + g.at) * kPanelWidth, g.weight * kPanelWidth});
  }
  return nodes;
}

// Coefficients of the cubic B-spline through `samples` at 0, 1, ..; `parity` says how they go on to the left of 0.
// Result [0] is coefficient -1.
std::array<double, kColumns> spline(const std::array<double, kNodes>& samples, double parity) {
  // (c[i-1] + 4 c[i] + c[i+1]) / 6 = sample; no curvature at the right end.
  std::array<double, kNodes> upper{};
  std::array<double, kNodes> c{};
  upper[0] = parity > 0.0 ? 0.5 : 0.0;
  c[0] = parity > 0.0 ? 1.5 * samples[0] : 0.0;
  for (std::size_t i = 1; i + 1 < kNodes; ++i) {
    const double pivot = 1.0 / (4.0 - upper[i - 1]);
    upper[i] = pivot;
    c[i] = (6.0 * samples[i] - c[i - 1]) * pivot;
  }
  c[kNodes - 1] = samples[kNodes - 1];
  for (std::size_t i = kNodes - 1; i-- > 0;) c[i] -= upper[i] * c[i + 1];
  std::array<double, kColumns> result{};
  result[0] = parity * c[1];
  std::copy_n(c.begin(), kColumns - 1, result.begin() + 1);
  return result;
}

// Lagrange through six nodes -2 .. 3, at 0 <= t <= 1.
std::array<double, kRowStencil> lagrange(double t) {
  const double a = t + 2.0;
  const double b = t + 1.0;
  const double d = t - 1.0;
  const double e = t - 2.0;
  const double f = t - 3.0;
  return {-b * t * d * e * f / 120.0, a * t * d * e * f / 24.0,  -a * b * d * e * f / 12.0,
          a * b * t * e * f / 12.0,   -a * b * t * d * f / 24.0, a * b * t * d * e / 120.0};
}

// B-spline's weights of coefficients -1 .. 2, at 0 <= t <= 1.
std::array<double, kColumnStencil> cubic(double t) {
  const double u = 1.0 - t;
  const double t3 = t * t * t;
  return {u * u * u / 6.0, (4.0 - 6.0 * t * t + 3.0 * t3) / 6.0, (1.0 + 3.0 * (t + t * t - t3)) / 6.0, t3 / 6.0};
}

struct Cell {
  std::size_t index;
  double t;
};

// Cell of a grid whose last node is `last`, and the place in it.
Cell cell_of(double thicknesses, std::size_t last) {
  const double steps = std::min(thicknesses * kStepsPerThickness, static_cast<double>(last));
  const std::size_t index = std::min(static_cast<std::size_t>(steps), last - 1);
  return {index, steps - static_cast<double>(index)};
}

// Slowest mode of the layer: the field falls as exp(-kappa r / h). First zero of the compliance's D(i kappa); that of
// the across part is pi / 2.
double slowest_mode(double nu) {
  double low = 0.5;
  double high = 0.5 * pi;
  for (int i = 0; i < 60; ++i) {
    const double y = 0.5 * (low + high);
    const double sine = portable::sin(y);
    const double half_d = 4.0 * (1.0 - nu) * (1.0 - nu) - (3.0 - 4.0 * nu) * sine * sine - y * y;
    (half_d > 0.0 ? low : high) = y;
  }
  return low;
}

// Johnson 3.41, outward and down, under the pressure sqrt(a^2 - r^2).
Spread half_space_press(const Gel& gel, double a, double r) {
  const double nu = gel.poisson;
  const double out = -(1.0 - 2.0 * nu) / (6.0 * gel.shear_modulus_mpa);
  const double down = (1.0 - nu) / (4.0 * gel.shear_modulus_mpa);
  if (r <= a) {
    // 1 - w^3 over 1 - w^2, w = sqrt(1 - r^2 / a^2)
    const double w = std::sqrt((1.0 - r / a) * (1.0 + r / a));
    return {out * a * r * (1.0 + w + w * w) / (1.0 + w), down * 0.5 * pi * (2.0 * a * a - r * r)};
  }
  const double e = a / r;
  const double e2 = e * e;
  // As dome_field_mm: r^2 ((2 e^2 - 1) asin e + e w) cancels for small e.
  const double bracket = e < 1.0 / 30.0
                             ? a * a * e * (4.0 / 3.0 + e2 * (2.0 / 15.0 + e2 * (3.0 / 70.0)))
                             : r * r * ((2.0 * e2 - 1.0) * portable::asin(e) + e * std::sqrt((1.0 - e) * (1.0 + e)));
  return {out * a * a * e, down * bracket};
}

// Johnson 3.9, around the centre, under full stick with 1 N mm.
double half_space_torque(const Gel& gel, double a, double r) {
  const double turn = 3.0 / (16.0 * gel.shear_modulus_mpa * a * a * a);
  if (r <= a) return turn * r;
  const double e = a / r;
  const double e2 = e * e;
  const double bracket = e < 1.0 / 30.0 ? e * e2 * (2.0 / 3.0 + e2 * (1.0 / 5.0 + e2 * (3.0 / 28.0)))
                                        : portable::asin(e) - e * std::sqrt((1.0 - e) * (1.0 + e));
  return turn * 2.0 / pi * r * bracket;
}

// asin of 0 <= e <= 1 without a branch, to 3e-13: polynomial for asin(x) / x in x^2 < 1/4, by its Chebyshev
// interpolation; the upper half by asin e = pi/2 - 2 asin(sqrt((1 - e) / 2)).
double quick_asin(double e) {
  const bool upper = e > 0.5;
  const double z = upper ? 0.5 * (1.0 - e) : e * e;
  double p = 0.028346745231833323;
  for (const double c : {0.0010675063150363193, 0.016864090273960117, 0.016902683886393575, 0.022412417726695433,
                         0.030379945210024933, 0.044642906474584965, 0.07499999953429712, 0.16666666666738633}) {
    p = p * z + c;
  }
  const double x = std::sqrt(z);
  const double s = x + x * z * p;
  return upper ? 0.5 * pi - 2.0 * s : s;
}

}  // namespace

LayerCompliance layer_compliance(const Gel& gel, double wavenumber_per_mm) {
  const double modulus = gel.shear_modulus_mpa;
  const double h = gel.thickness_mm;
  if (!(h > 0.0)) return {};
  const double k = std::abs(wavenumber_per_mm);
  const bool thin = k * h < kThick;  // not for 0 * infinity
  const double scale = thin ? h / modulus : 1.0 / modulus / k;
  const LayerCompliance unit = thin ? compliance_per_thickness(gel.poisson, k * h) : half_space_compliance(gel.poisson);
  return {scale * unit.along, scale * unit.across, unit.normal == 0.0 ? 0.0 : scale * unit.normal,
          unit.coupling == 0.0 ? 0.0 : scale * unit.coupling};
}

struct Layer::Tables {
  struct Row {
    std::array<Spread, kColumns> coefficient{};
  };
  using Grid = std::array<Row, kRows>;

  explicit Tables(double nu) : slowest(slowest_mode(nu)) {
    fill_fields(nu);
    fill_press(nu);
  }
  void fill_fields(double nu);
  void fill_press(double nu);

  [[nodiscard]] const Grid& grid(Load load) const { return grids[static_cast<std::size_t>(load)]; }
  // Rows of the stencil around a; the tables are even in a.
  [[nodiscard]] static std::array<std::size_t, kRowStencil> rows(std::size_t index) {
    const auto mirrored = [index](std::size_t i) { return index + i >= 2 ? index + i - 2 : 2 - index - i; };
    return {mirrored(0), mirrored(1), index, index + 1, index + 2, index + 3};
  }
  // In units of 1 / (G h) a newton; 1 / (G h^2) a newton millimetre.
  [[nodiscard]] Spread at(Load load, double a_thicknesses, double r_thicknesses) const;

  double slowest;
  std::array<Grid, 4> grids{};
  // Sphere: not even in a; from two steps before 0 on.
  std::array<PressRatio, kRows + 2> press{};
};

void Layer::Tables::fill_fields(double nu) {
  using Samples = std::array<double, kNodes>;
  const std::vector<Node> waves = wavenumbers();
  std::vector<std::array<Samples, 3>> j(waves.size());
  for (std::size_t k = 0; k < waves.size(); ++k) {
    for (std::size_t i = 0; i < kNodes; ++i) {
      const Bessel value = bessel(waves[k].at * static_cast<double>(i) / kStepsPerThickness);
      for (std::size_t n = 0; n < value.size(); ++n) j[k][n][i] = value[n];
    }
  }
  std::vector<LayerCompliance> kernel(waves.size());
  for (std::size_t k = 0; k < waves.size(); ++k) kernel[k] = difference(nu, waves[k].at);

  for (std::size_t row = 0; row < kRows; ++row) {
    const double a = static_cast<double>(row) / kStepsPerThickness;
    struct Sums {
      Samples first{};
      Samples second{};
    };
    std::array<Sums, 4> sums{};
    const auto add = [](Samples& to, double weight, const Samples& values) {
      for (std::size_t i = 0; i < kNodes; ++i) to[i] += weight * values[i];
    };
    for (std::size_t k = 0; k < waves.size(); ++k) {
      const double kh = waves[k].at;
      const double dome = waves[k].weight * dome_transform(kh * a) / (4.0 * pi);
      const double punch = waves[k].weight * punch_transform(kh * a) / (4.0 * pi);
      const LayerCompliance& d = kernel[k];
      add(sums[0].first, dome * (d.along + d.across), j[k][0]);
      add(sums[0].second, dome * (d.across - d.along), j[k][2]);
      add(sums[1].first, punch * (d.along + d.across), j[k][0]);
      add(sums[1].second, punch * (d.across - d.along), j[k][2]);
      add(sums[2].first, dome * d.across * kh, j[k][1]);
      add(sums[3].first, -2.0 * dome * d.coupling, j[k][1]);
      add(sums[3].second, 2.0 * dome * d.normal, j[k][0]);
    }
    constexpr std::array<double, 4> kParity{1.0, 1.0, -1.0, -1.0};  // of the first sum; the second is even
    for (std::size_t load = 0; load < sums.size(); ++load) {
      const auto first = spline(sums[load].first, kParity[load]);
      const auto second = spline(sums[load].second, 1.0);
      Row& target = grids[load][row];
      for (std::size_t i = 0; i < kColumns; ++i) target.coefficient[i] = {first[i], second[i]};
    }
  }
}

// Frictionless sphere. With the pressure's transform written as the integral of phi(t) cos(kt) over 0 < t < a (Popov's
// line load), the half-space's problem is phi(x) = (2/pi) G/(1-nu) (d - x^2/R); the layer adds (2/pi) times the
// integral of phi(t) M(x, t), M = integral of L(k) cos kx cos kt dk, L = (layer - half-space) / half-space. No edge:
// phi(a) = 0. In units of a and of the half-space's phi: chi(s) + (2/pi) a int chi M = depth - s^2, solved at Gauss
// points.
void Layer::Tables::fill_press(double nu) {
  constexpr std::size_t kPoints = 2 * kGauss.size() + 1;  // the last is the rim, of weight 0
  using Vector = std::array<double, kPoints>;
  Vector s{};
  Vector weight{};
  for (std::size_t i = 0; i < kGauss.size(); ++i) {
    for (std::size_t half = 0; half < 2; ++half) {
      s[2 * i + half] = 0.5 * (static_cast<double>(half) + kGauss[i].at);
      weight[2 * i + half] = 0.5 * kGauss[i].weight;
    }
  }
  s[kPoints - 1] = 1.0;

  const std::vector<Node> waves = wavenumbers();
  std::vector<double> kernel(waves.size());
  for (std::size_t k = 0; k < waves.size(); ++k) {
    kernel[k] = 2.0 / pi * waves[k].weight * difference(nu, waves[k].at).normal / (1.0 - nu);
  }
  std::vector<Vector> cosine(waves.size());
  for (std::size_t row = 0; row < press.size(); ++row) {
    const double a = (static_cast<double>(row) - 2.0) / kStepsPerThickness;
    // Columns kPoints, kPoints + 1: right hand sides 1 and s^2.
    std::array<std::array<double, kPoints + 2>, kPoints> m{};
    for (std::size_t k = 0; k < waves.size(); ++k) {
      for (std::size_t i = 0; i < kPoints; ++i) cosine[k][i] = portable::cos(waves[k].at * a * s[i]);
      for (std::size_t i = 0; i < kPoints; ++i) {
        const double scale = kernel[k] * a * cosine[k][i];
        for (std::size_t t = 0; t < kPoints; ++t) m[i][t] += scale * cosine[k][t];
      }
    }
    for (std::size_t i = 0; i < kPoints; ++i) {
      for (std::size_t t = 0; t < kPoints; ++t) m[i][t] *= weight[t];
      m[i][i] += 1.0;
      m[i][kPoints] = 1.0;
      m[i][kPoints + 1] = s[i] * s[i];
    }
    for (std::size_t c = 0; c < kPoints; ++c) {
      std::size_t pivot = c;
      for (std::size_t i = c + 1; i < kPoints; ++i) {
        if (std::abs(m[i][c]) > std::abs(m[pivot][c])) pivot = i;
      }
      std::swap(m[c], m[pivot]);
      for (std::size_t i = 0; i < kPoints; ++i) {
        if (i == c) continue;
        const double factor = m[i][c] / m[c][c];
        for (std::size_t t = c; t < kPoints + 2; ++t) m[i][t] -= factor * m[c][t];
      }
    }
    const auto solution = [&m](std::size_t i, std::size_t side) { return m[i][kPoints + side] / m[i][i]; };
    const double depth = solution(kPoints - 1, 1) / solution(kPoints - 1, 0);
    Vector chi{};
    double sum = 0.0;
    for (std::size_t i = 0; i < kPoints; ++i) {
      chi[i] = depth * solution(i, 0) - solution(i, 1);
      sum += weight[i] * chi[i];
    }
    // p(0) = -integral of phi'(t) / t.
    double peak = 1.0;
    for (std::size_t k = 0; k < waves.size(); ++k) {
      const double ka = waves[k].at * a;
      double moment = 0.0;
      double sine = 0.0;
      for (std::size_t i = 0; i < kPoints; ++i) {
        moment += weight[i] * chi[i] * cosine[k][i];
        sine += weight[i] * portable::sin(ka * s[i]) / s[i];
      }
      peak -= 0.5 * kernel[k] * a * ka * moment * sine;
    }
    press[row] = {1.5 * sum, depth, peak};
  }
}

Spread Layer::Tables::at(Load load, double a_thicknesses, double r_thicknesses) const {
  const Cell a = cell_of(a_thicknesses, kLastRow);
  const Cell r = cell_of(r_thicknesses, kLastColumn);
  const auto row = rows(a.index);
  const auto row_weight = lagrange(a.t);
  const auto column_weight = cubic(r.t);
  Spread sum;
  for (std::size_t i = 0; i < kRowStencil; ++i) {
    Spread line;
    for (std::size_t c = 0; c < kColumnStencil; ++c) {
      const Spread& value = grid(load)[row[i]].coefficient[r.index + c];
      line.mean += column_weight[c] * value.mean;
      line.fan += column_weight[c] * value.fan;
    }
    sum.mean += row_weight[i] * line.mean;
    sum.fan += row_weight[i] * line.fan;
  }
  return sum;
}

Layer::Layer(const Gel& gel) : gel_(gel) {
  if (gel.thickness_mm > 0.0 && std::isfinite(gel.thickness_mm)) tables_ = std::make_shared<const Tables>(gel.poisson);
}

// The half-space's own.
Spread Layer::half_space(Load load, double a, double r) const {
  const double diagonal = r * std::numbers::sqrt2 / 2.0;  // where mean and fan are the two components
  switch (load) {
    case Load::kDome: {
      const Vec2 u = dome_field_mm(gel_, a, 1.0, {diagonal, diagonal});
      return {u.x, u.y};
    }
    case Load::kPunch: {
      const Vec2 u = stuck_field_mm(gel_, a, 1.0, {diagonal, diagonal});
      return {u.x, u.y};
    }
    case Load::kTorque:
      return {half_space_torque(gel_, a, r), 0.0};
    case Load::kPress:
      return half_space_press(gel_, a, r);
  }
  return {};
}

// Factor of the table's numbers: the load over G h.
double Layer::unit(Load load, double a) const {
  const double per_newton = 1.0 / (gel_.shear_modulus_mpa * gel_.thickness_mm);
  switch (load) {
    case Load::kDome:
    case Load::kPress:
      return 2.0 / 3.0 * pi * a * a * a * per_newton;
    case Load::kPunch:
      return per_newton;
    case Load::kTorque:
      return per_newton / gel_.thickness_mm;
  }
  return 0.0;
}

// What is left at r > kFarDistance h of the motion at kFarDistance h: modified Bessel functions K_n, two terms.
Spread Layer::fall(Load load, double r) const {
  const double kappa = load == Load::kTorque ? 0.5 * pi : tables_->slowest;
  const double x = r / gel_.thickness_mm;
  const double decay = std::sqrt(kFarDistance / x) * portable::exp(-kappa * (x - kFarDistance));
  const auto bessel_k = [&](int order) {
    const double c = (4.0 * order * order - 1.0) / (8.0 * kappa);
    return decay * (1.0 + c / x) / (1.0 + c / kFarDistance);
  };
  const bool odd = load == Load::kTorque || load == Load::kPress;
  return {bessel_k(odd ? 1 : 0), bessel_k(load == Load::kPress ? 0 : 2)};
}

Spread Layer::tabled_motion(Load load, double a, double r) const {
  const double h = gel_.thickness_mm;
  const double near = std::min(r, kFarDistance * h);
  const Spread half = half_space(load, a, near);
  const Spread difference = tables_->at(load, a / h, near / h);
  const double scale = unit(load, a);
  const Spread sum{half.mean + scale * difference.mean, half.fan + scale * difference.fan};
  if (r <= near) return sum;
  const Spread left = fall(load, r);
  return {sum.mean * left.mean, sum.fan * left.fan};
}

// Disc of more than kMostRadius h: near the rim the field of kMostRadius h moved outwards (it is a strip's there),
// inside the same stretched; both scaled by the local motion of a thin layer, whose leading terms are h/G times
//   dome q = s = sqrt(a^2 - r^2), punch q ~ 1 / (a s), torque q ~ r / (a^3 s); fan: r (q' / r)', so r^2 / s^3 and
//   r^2 / (a s^5); press outward p' ~ r / s; down c1 s - c3 h^2 (laplacian of s), c3 for what flows sideways.
Spread Layer::thin_motion(Load load, double a, double r) const {
  constexpr double kA = kMostRadius;
  constexpr double kRim = 0.5 * kA;
  const double h = gel_.thickness_mm;
  const double big = a / h;
  const double x = r / h;
  const bool deep = x < big - kRim;
  const double stretch = (big - kRim) / (kA - kRim);
  const double y = deep ? x / stretch : kA + (x - big);
  const Spread table = tabled_motion(load, kA * h, y * h);

  const bool outside = x >= big;
  const double gap = deep ? (big - x) / (kA - y) : 1.0;  // of the distances to the rim
  const double reach = outside ? big / kA : (big + x) / (kA + y);
  const double s = std::sqrt(gap * reach);
  const double way = deep ? stretch : (outside ? big / kA : x / y);  // of the distances to the centre
  const double radius = big / kA;
  switch (load) {
    case Load::kDome:
      return {table.mean * s, table.fan * (way / s) * (way / s) / s};
    case Load::kPunch:
      return {table.mean / (radius * s), table.fan * (way / s) * (way / s) / (s * s * s * radius)};
    case Load::kTorque:
      return {table.mean * (way / s) / (radius * radius * radius), 0.0};
    case Load::kPress: {
      const double nu = gel_.poisson;
      const double c1 = 0.5 * (1.0 - 2.0 * nu) / (1.0 - nu);
      const double c3 = std::max(0.0, nu * (4.0 * nu - 1.0)) / (6.0 * (1.0 - nu) * (1.0 - nu));
      // s^4 times the local motion; never 0, so that the ratio at and outside the rim is the one of its limit.
      const double inside = std::max(1e-9, kA - y);
      const auto local = [c1, c3](double to_rim, double place) {
        return c1 * to_rim * to_rim + c3 * (2.0 - place * place) / ((1.0 + place) * (1.0 + place));
      };
      const double ratio = local(gap * inside, std::min(1.0, x / big)) / local(inside, std::min(1.0, y / kA));
      return {table.mean * (way / s), table.fan * s * ratio / (gap * gap)};
    }
  }
  return {};
}

Spread Layer::motion(Load load, double a, double r) const {
  if (!(a > 0.0) || !(gel_.thickness_mm > 0.0)) return {};
  if (!tables_) return half_space(load, a, r);
  return a > kMostRadius * gel_.thickness_mm ? thin_motion(load, a, r) : tabled_motion(load, a, r);
}

Spread Layer::dome(double a_mm, double r_mm) const {
  return motion(Load::kDome, a_mm, r_mm);
}

Spread Layer::punch(double a_mm, double r_mm) const {
  return motion(Load::kPunch, a_mm, r_mm);
}

double Layer::torque(double a_mm, double r_mm) const {
  return motion(Load::kTorque, a_mm, r_mm).mean;
}

double Layer::press_outward(double a_mm, double r_mm) const {
  return motion(Load::kPress, a_mm, r_mm).mean;
}

double Layer::press_sink(double a_mm, double r_mm) const {
  return motion(Load::kPress, a_mm, r_mm).fan;
}

void Layer::dome(double a_mm, std::span<const double> r_mm, std::span<double> mean, std::span<double> fan) const {
  spread(Load::kDome, a_mm, r_mm, mean, fan);
}

void Layer::punch(double a_mm, std::span<const double> r_mm, std::span<double> mean, std::span<double> fan) const {
  spread(Load::kPunch, a_mm, r_mm, mean, fan);
}

void Layer::spread(Load load, double a, std::span<const double> r, std::span<double> mean,
                   std::span<double> fan) const {
  const double h = gel_.thickness_mm;
  if (!(a > 0.0) || !(h > 0.0) || (tables_ && a > kMostRadius * h)) {
    for (std::size_t i = 0; i < r.size(); ++i) {
      const Spread one = motion(load, a, r[i]);
      mean[i] = one.mean;
      fan[i] = one.fan;
    }
    return;
  }
  // Half-space. Inside the disc e = 1, asin e = pi/2 and w = 0 make the outer formulas the inner ones.
  const double nu = gel_.poisson;
  const double modulus = gel_.shear_modulus_mpa;
  const bool dome = load == Load::kDome;
  const double mean_scale = dome ? (2.0 - nu) / (8.0 * modulus) : (2.0 - nu) / (4.0 * pi * modulus * a);
  const double fan_scale = dome ? nu / (16.0 * modulus) : nu / (4.0 * pi * modulus * a);
  if (dome) {
    for (std::size_t i = 0; i < r.size(); ++i) {
      const double out = std::max(r[i], a);
      const double e = a / out;
      const double e2 = e * e;
      const double s = quick_asin(e);
      const double w = std::sqrt((1.0 - e) * (1.0 + e));
      const double rr = r[i] * r[i];
      const double rest = 2.0 * a * a - rr;
      const double near_mean = rest * s + a * out * w;
      const double near_fan = rr * s + rest * w * e;
      // As in dome_field_mm.
      const double cubic = a * a * e;
      const double far_mean = cubic * (4.0 / 3.0 + e2 * (2.0 / 15.0 + e2 * (3.0 / 70.0)));
      const double far_fan = cubic * (8.0 / 3.0 - e2 * (4.0 / 5.0 + e2 * (1.0 / 7.0)));
      mean[i] = mean_scale * (e < 1.0 / 30.0 ? far_mean : near_mean);
      fan[i] = fan_scale * (e < 1.0 / 30.0 ? far_fan : near_fan);
    }
  } else {
    for (std::size_t i = 0; i < r.size(); ++i) {
      const double e = a / std::max(r[i], a);
      mean[i] = mean_scale * quick_asin(e);
      fan[i] = fan_scale * e * std::sqrt((1.0 - e) * (1.0 + e));
    }
  }
  if (!tables_) return;

  // One row of the table for this a, as far as the distances reach.
  const double per_h = 1.0 / h;
  double most = 0.0;
  for (const double distance : r) most = std::max(most, distance);
  const std::size_t columns = cell_of(most * per_h, kLastColumn).index + kColumnStencil;
  const Cell cell = cell_of(a * per_h, kLastRow);
  const auto row = Tables::rows(cell.index);
  const auto weight = lagrange(cell.t);
  const double scale = unit(load, a);
  std::array<Spread, kColumns> line;
  for (std::size_t i = 0; i < columns; ++i) line[i] = {};
  for (std::size_t k = 0; k < kRowStencil; ++k) {
    const double factor = weight[k] * scale;
    const auto& from = tables_->grid(load)[row[k]].coefficient;
    for (std::size_t i = 0; i < columns; ++i) {
      line[i].mean += factor * from[i].mean;
      line[i].fan += factor * from[i].fan;
    }
  }
  for (std::size_t i = 0; i < r.size(); ++i) {
    if (r[i] > kFarDistance * h) {
      const Spread far = tabled_motion(load, a, r[i]);
      mean[i] = far.mean;
      fan[i] = far.fan;
      continue;
    }
    const Cell at = cell_of(r[i] * per_h, kLastColumn);
    const auto w = cubic(at.t);
    const Spread* c = &line[at.index];
    mean[i] += w[0] * c[0].mean + w[1] * c[1].mean + w[2] * c[2].mean + w[3] * c[3].mean;
    fan[i] += w[0] * c[0].fan + w[1] * c[1].fan + w[2] * c[2].fan + w[3] * c[3].fan;
  }
}

LayerPoint Layer::point(double r_mm) const {
  if (!tables_) return {};
  const double nu = gel_.poisson;
  const double h = gel_.thickness_mm;
  const auto half_space_at = [&](double r) {
    const double unit = 1.0 / (4.0 * pi * gel_.shear_modulus_mpa * r);
    return LayerPoint{(2.0 - nu) * unit, nu * unit, -(1.0 - 2.0 * nu) * unit, 2.0 * (1.0 - nu) * unit};
  };
  const double scale = unit(Load::kPunch, 0.0);
  const Spread tangential = tables_->at(Load::kPunch, 0.0, r_mm / h);
  const Spread normal = tables_->at(Load::kPress, 0.0, r_mm / h);
  const LayerPoint difference{scale * tangential.mean, scale * tangential.fan, scale * normal.mean, scale * normal.fan};
  if (r_mm <= kFarDistance * h) return difference;
  const LayerPoint there = half_space_at(r_mm);
  const LayerPoint last = half_space_at(kFarDistance * h);
  const Spread shear = fall(Load::kPunch, r_mm);
  const Spread press = fall(Load::kPress, r_mm);
  return {(last.mean + difference.mean) * shear.mean - there.mean, (last.fan + difference.fan) * shear.fan - there.fan,
          (last.outward + difference.outward) * press.mean - there.outward,
          (last.sink + difference.sink) * press.fan - there.sink};
}

PressRatio Layer::press_ratio(double a_mm) const {
  if (!tables_ || !(a_mm > 0.0)) return {};
  const auto& table = tables_->press;
  const double a = a_mm / gel_.thickness_mm;
  if (a <= kMostRadius) {
    const Cell cell = cell_of(a, kLastRow);
    const auto weight = lagrange(cell.t);
    PressRatio sum{0.0, 0.0, 0.0};
    for (std::size_t i = 0; i < kRowStencil; ++i) {
      const PressRatio& node = table[cell.index + i];
      sum.force += weight[i] * node.force;
      sum.depth += weight[i] * node.depth;
      sum.peak_pressure += weight[i] * node.peak_pressure;
    }
    return sum;
  }
  // On as the power of a that it is there; the profile stays.
  const PressRatio& last = table[kLastRow + 2];
  const double power =
      kMostRadius * 0.5 * kStepsPerThickness * (table[kLastRow + 3].force - table[kLastRow + 1].force) / last.force;
  const double growth = portable::exp(power * portable::log(a / kMostRadius));
  return {last.force * growth, last.depth, last.peak_pressure * growth};
}

// a with (a / hertz)^power * ratio(a) = 1. Both logarithms are near to a straight line: secants.
double Layer::radius_from(double hertz, double power, double PressRatio::*ratio) const {
  const auto excess = [&](double log_a) {
    return power * log_a + portable::log(press_ratio(hertz * portable::exp(log_a)).*ratio);
  };
  double x0 = 0.0;
  double f0 = excess(x0);
  double x1 = -f0 / power;
  for (int i = 0; i < 40; ++i) {
    const double f1 = excess(x1);
    const double slope = (f1 - f0) / (x1 - x0);
    if (!(std::abs(slope) > 0.0) || !std::isfinite(slope)) break;  // the two points are one
    x0 = x1;
    f0 = f1;
    x1 -= f1 / slope;
    if (std::abs(x1 - x0) < 1e-15) break;
  }
  return hertz * portable::exp(x1);
}

Press Layer::press_by_force(double sphere_radius_mm, double force_n) const {
  const Press hertz = press_sphere(gel_, sphere_radius_mm, force_n);
  if (!tables_ || !(hertz.contact_radius_mm > 0.0)) return gel_.thickness_mm > 0.0 ? hertz : Press{};
  Press press = pressed(sphere_radius_mm, radius_from(hertz.contact_radius_mm, 3.0, &PressRatio::force));
  press.force_n = press.contact_radius_mm > 0.0 ? force_n : 0.0;
  return press;
}

Press Layer::press_by_depth(double sphere_radius_mm, double depth_mm) const {
  if (!(sphere_radius_mm > 0.0) || !(depth_mm > 0.0) || !(gel_.thickness_mm > 0.0)) return {};
  const double hertz = std::sqrt(sphere_radius_mm) * std::sqrt(depth_mm);
  if (!std::isfinite(hertz) || !(hertz > 0.0)) return {};
  return pressed(sphere_radius_mm, tables_ ? radius_from(hertz, 2.0, &PressRatio::depth) : hertz);
}

Press Layer::pressed(double sphere_radius_mm, double a) const {
  if (!(a * a > 0.0) || !std::isfinite(a * a)) return {};
  const PressRatio ratio = press_ratio(a);
  const double modulus = effective_modulus_mpa(gel_);
  return {4.0 / 3.0 * modulus * a * a * (a / sphere_radius_mm) * ratio.force, a,
          a * (a / sphere_radius_mm) * ratio.depth, 2.0 / pi * modulus * (a / sphere_radius_mm) * ratio.peak_pressure};
}

}  // namespace holdfast::scene
