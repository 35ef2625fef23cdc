// SPDX-License-Identifier: Apache-2.0
// Oracles: the strip's elasticity integrated through its thickness (matrix exponential, no formula of ours), Hankel
// integrals of the whole layer with the library's Bessel functions, the ratios that a 2-D FFT gave
// (contact-mechanics notes 2.6), a contact solved by collocation in another basis, Dimitriadis's series, and the
// limits.
#include "drivers/sim/scene/contact/layer.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <utility>
#include <vector>

#include <CppUTest/TestHarness.h>

using namespace holdfast::scene;
using std::numbers::pi;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr std::array<double, 5> kPoissons{0.0, 0.2, 0.4, 0.49, 0.5};

using Matrix = std::array<std::array<long double, 4>, 4>;

Matrix product(const Matrix& a, const Matrix& b) {
  Matrix c{};
  for (std::size_t i = 0; i < 4; ++i) {
    for (std::size_t j = 0; j < 4; ++j) {
      for (std::size_t k = 0; k < 4; ++k) c[i][j] += a[i][k] * b[k][j];
    }
  }
  return c;
}

// Plane strain, u = U cos kx, w = W sin kx (up), stresses T cos kx along and N sin kx up, G = h = 1:
//   U' = T - K W,  W' = nu/(1-nu) K U + (1-2nu)/(2(1-nu)) N,  T' = 2/(1-nu) K^2 U - nu/(1-nu) K N,  N' = K T.
// From U = W = 0 on the glass to T, N at the surface.
LayerCompliance integrated(double nu, double kh) {
  const long double n = nu;
  const long double k = kh;
  Matrix a{{{0, -k, 1, 0},
            {n / (1 - n) * k, 0, 0, (1 - 2 * n) / (2 * (1 - n))},
            {2 / (1 - n) * k * k, 0, 0, -n / (1 - n) * k},
            {0, 0, k, 0}}};
  constexpr int kHalvings = 10;
  for (auto& row : a) {
    for (long double& value : row) value /= 1 << kHalvings;
  }
  Matrix sum{};
  Matrix term{};
  for (std::size_t i = 0; i < 4; ++i) sum[i][i] = term[i][i] = 1;
  for (int order = 1; order < 16; ++order) {
    term = product(term, a);
    for (std::size_t i = 0; i < 4; ++i) {
      for (std::size_t j = 0; j < 4; ++j) sum[i][j] += (term[i][j] /= order);
    }
  }
  for (int i = 0; i < kHalvings; ++i) sum = product(sum, sum);
  const long double det = sum[2][2] * sum[3][3] - sum[2][3] * sum[3][2];
  const auto solve = [&](std::size_t row, long double t, long double s) {  // row U or W under T = t, N = s
    const long double t0 = (sum[3][3] * t - sum[2][3] * s) / det;
    const long double n0 = (sum[2][2] * s - sum[3][2] * t) / det;
    return static_cast<double>(sum[row][2] * t0 + sum[row][3] * n0);
  };
  // cos kx = -sin(kx - pi/2) turns (U, N) into the header's coupling; equal to (W, T) by Betti.
  DOUBLES_EQUAL(solve(0, 0, 1), solve(1, 1, 0), 1e-10);
  return {solve(0, 1, 0), std::tanh(kh) / kh, solve(1, 0, 1), -solve(0, 0, 1)};
}

// Textbook form, G = 1.
LayerCompliance textbook(double nu, double h, double k) {
  const double kh = k * h;
  if (kh > 20.0) return {(1.0 - nu) / k, 1.0 / k, (1.0 - nu) / k, 0.5 * (1.0 - 2.0 * nu) / k};
  const double d = (3 - 4 * nu) * std::cosh(2 * kh) + 2 * kh * kh + 5 - 12 * nu + 8 * nu * nu;
  return {(1 - nu) / k * ((3 - 4 * nu) * std::sinh(2 * kh) + 2 * kh) / d, std::tanh(kh) / k,
          (1 - nu) / k * ((3 - 4 * nu) * std::sinh(2 * kh) - 2 * kh) / d,
          ((1 - 2 * nu) * (3 - 4 * nu) * (std::cosh(2 * kh) - 1) - 2 * kh * kh) / (2 * k * d)};
}

// Integral over 0 < k < reach, panels no wider than `panel`; 8 points of Gauss-Legendre.
double integral(double reach, double panel, const std::function<double(double)>& f) {
  static constexpr std::array<std::pair<double, double>, 4> kHalf{{{0.1834346424956498, 0.3626837833783620},
                                                                   {0.5255324099163290, 0.3137066458778873},
                                                                   {0.7966664774136267, 0.2223810344533745},
                                                                   {0.9602898564975363, 0.1012285362903763}}};
  const int panels = static_cast<int>(reach / panel) + 1;
  const double half = 0.5 * reach / panels;
  double sum = 0.0;
  for (int i = 0; i < panels; ++i) {
    for (const auto& [x, weight] : kHalf) {
      sum += weight * (f(half * (2 * i + 1 - x)) + f(half * (2 * i + 1 + x)));
    }
  }
  return sum * half;
}

double bessel_j(int order, double x) {
  return std::cyl_bessel_j(static_cast<double>(order), x);
}

// Whole fields of a layer with G = h = 1 (h may be infinite), from the definition. The integral is cut softly at
// k a = 100, which blurs the load by a / 100, and by the fourth derivative only: 1e-5 away from the rim.
struct Fields {
  Spread dome;
  Spread punch;
  double torque = 0.0;
  double outward = 0.0;
  double sink = 0.0;
};

Fields integrated_fields(double nu, double h, double a, double r) {
  const double soft = 100.0 / a;
  const double panel = std::min(0.5, 3.0 / (a + r));
  const auto hankel = [&](int order, const auto& kernel) {
    return integral(1.8 * soft, panel, [&](double k) {
      return kernel(k) * bessel_j(order, k * r) * k * std::exp(-std::pow(k / soft, 4.0));
    });
  };
  const auto dome = [&](double k) { return a * a * std::sph_bessel(1, k * a) / k; };
  const auto punch = [&](double k) { return std::sph_bessel(0, k * a) / (2.0 * pi); };
  const auto both = [&](double k) { return 0.5 * (textbook(nu, h, k).along + textbook(nu, h, k).across); };
  const auto apart = [&](double k) { return 0.5 * (textbook(nu, h, k).across - textbook(nu, h, k).along); };
  return {
      {hankel(0, [&](double k) { return both(k) * dome(k); }), hankel(2, [&](double k) { return apart(k) * dome(k); })},
      {hankel(0, [&](double k) { return both(k) * punch(k); }),
       hankel(2, [&](double k) { return apart(k) * punch(k); })},
      hankel(1, [&](double k) { return textbook(nu, h, k).across * 3.0 / (4.0 * pi * a) * std::sph_bessel(1, k * a); }),
      hankel(1, [&](double k) { return -textbook(nu, h, k).coupling * dome(k); }),
      hankel(0, [&](double k) { return textbook(nu, h, k).normal * dome(k); }),
  };
}

// A sphere on a layer by another basis and another method: pressure = sum of c_j (1 - r^2/a^2)^(j - 1/2), whose
// transforms are spherical Bessel functions, so that the layer sinks by depth - r^2 / 2R at 9 places in the contact
// (least squares).
PressRatio collocated(double nu, double a) {
  constexpr std::size_t kTerms = 5;
  constexpr std::size_t kPlaces = 9;
  // Unknowns: c_1 .. c_5 and the depth; G = h = R = 1.
  std::array<std::array<double, kTerms + 2>, kTerms + 1> m{};
  for (std::size_t p = 0; p < kPlaces; ++p) {
    const double r = a * static_cast<double>(p) / (kPlaces - 1) * 0.9;
    std::array<double, kTerms + 2> row{};
    double gamma = std::sqrt(pi) / 2.0;  // Gamma(j + 1/2)
    for (std::size_t j = 1; j <= kTerms; ++j) {
      const double scale = a * a * std::pow(2.0, static_cast<double>(j) - 0.5) * gamma * std::sqrt(2.0 / pi);
      gamma *= static_cast<double>(j) + 0.5;
      row[j - 1] = integral(180.0 / a, std::min(0.5, 2.0 / a), [&](double k) {
        const double x = k * a;
        return scale * std::sph_bessel(static_cast<unsigned>(j), x) / std::pow(x, static_cast<double>(j)) *
               textbook(nu, 1.0, k).normal * k * bessel_j(0, k * r) * std::exp(-std::pow(x / 100.0, 4.0));
      });
    }
    row[kTerms] = -1.0;
    row[kTerms + 1] = -0.5 * r * r;
    for (std::size_t i = 0; i <= kTerms; ++i) {
      for (std::size_t j = 0; j < row.size(); ++j) m[i][j] += row[i] * row[j];
    }
  }
  for (std::size_t c = 0; c <= kTerms; ++c) {
    for (std::size_t i = 0; i <= kTerms; ++i) {
      if (i == c) continue;
      const double factor = m[i][c] / m[c][c];
      for (std::size_t j = c; j < m[i].size(); ++j) m[i][j] -= factor * m[c][j];
    }
  }
  double force = 0.0;
  double peak = 0.0;
  for (std::size_t j = 0; j < kTerms; ++j) {
    const double c = m[j][kTerms + 1] / m[j][j];
    force += c * 2.0 * pi * a * a / (2.0 * static_cast<double>(j) + 3.0);
    peak += c;
  }
  const double modulus = effective_modulus_mpa({1.0, nu, 1.0});
  return {force / (4.0 / 3.0 * modulus * a * a * a), m[kTerms][kTerms + 1] / m[kTerms][kTerms] / (a * a),
          peak / (2.0 / pi * modulus * a)};
}

void check_near(Spread expected, Spread actual, double tolerance) {
  DOUBLES_EQUAL(expected.mean, actual.mean, tolerance);
  DOUBLES_EQUAL(expected.fan, actual.fan, tolerance);
}

std::array<double, 7> all_fields(const Layer& layer, double a, double r) {
  const Spread dome = layer.dome(a, r);
  const Spread punch = layer.punch(a, r);
  return {dome.mean,
          dome.fan,
          punch.mean,
          punch.fan,
          layer.torque(a, r),
          layer.press_outward(a, r),
          layer.press_sink(a, r)};
}

// Largest of each field over r; outside a small disc is where the layer pushes most outwards.
std::array<double, 7> sizes(const Layer& layer, double a) {
  std::array<double, 7> most{};
  for (int step = 0; step <= 48; ++step) {
    const auto value = all_fields(layer, a, step <= 24 ? step * a / 16.0 : 1.5 * a + (step - 24) / 12.0);
    for (std::size_t i = 0; i < most.size(); ++i) most[i] = std::max(most[i], std::abs(value[i]));
  }
  most[1] = most[0];  // a fan counts against its mean
  most[3] = most[2];
  return most;
}

void check_same(const LayerCompliance& expected, const LayerCompliance& actual, double relative) {
  DOUBLES_EQUAL(expected.along, actual.along, relative * std::abs(expected.along));
  DOUBLES_EQUAL(expected.across, actual.across, relative * std::abs(expected.across));
  DOUBLES_EQUAL(expected.normal, actual.normal, relative * std::abs(expected.along));
  DOUBLES_EQUAL(expected.coupling, actual.coupling, relative * std::abs(expected.along));
}

}  // namespace

TEST_GROUP(LayerCompliance){};

TEST(LayerCompliance, SolvesTheStripOnGlass) {
  for (const double nu : kPoissons) {
    for (const double kh : {0.01, 0.1, 0.49, 0.5, 0.99, 1.0, 2.0, 5.0, 10.0}) {
      const Gel gel{2.0, nu, 0.5};
      LayerCompliance expected = integrated(nu, kh);
      for (double* value : {&expected.along, &expected.across, &expected.normal, &expected.coupling}) *value *= 0.25;
      check_same(expected, layer_compliance(gel, kh / 0.5), 1e-9);  // the exponential's condition, exp(2K)
    }
  }
}

TEST(LayerCompliance, FiniteOrTheHonestLimitFromDenormalToHuge) {
  constexpr std::array<double, 9> kSizes{5e-324, 1e-300, 1e-40, 1e-6, 1.0, 1e6, 1e40, 1e300, 1.7e308};
  for (const double nu : kPoissons) {
    for (const double k : kSizes) {
      for (const double h : kSizes) {
        for (const double modulus : {1e-40, 1.0, 1e40}) {
          const LayerCompliance c = layer_compliance({modulus, nu, h}, k);
          for (const double value : {c.along, c.across, c.normal, c.coupling}) CHECK(!std::isnan(value));
          // Shear lies between half and once min(h, 1/k) / G.
          const double size = std::min(h, 1.0 / k) / modulus;
          CHECK(c.across >= 0.5 * size);
          CHECK(c.across <= 1.0001 * size);
        }
      }
    }
    CHECK_EQUAL(kInfinity, layer_compliance({1.0, nu, kInfinity}, 0.0).along);
    CHECK(!std::isnan(layer_compliance({1.0, nu, kInfinity}, 0.0).coupling));
  }
  CHECK_EQUAL(0.0, layer_compliance({1.0, 0.5, 0.0}, 1.0).along);
}

TEST_GROUP(Layer){};

TEST(Layer, FieldsAreTheHankelIntegralsOfTheLayer) {
  struct Case {
    double nu;
    double a;
    double r;
  };
  // In thicknesses; beyond 12 too.
  constexpr std::array<Case, 12> kCases{{{0.5, 0.47, 0.0},
                                         {0.5, 0.47, 0.3},
                                         {0.5, 0.47, 1.41},
                                         {0.5, 1.33, 1.1},
                                         {0.5, 1.33, 2.9},
                                         {0.5, 4.0, 0.0},
                                         {0.5, 3.97, 3.3},
                                         {0.49, 2.2, 5.1},
                                         {0.49, 4.0, 13.5},
                                         {0.3, 1.0, 0.6},
                                         {0.0, 0.9, 2.0},
                                         {0.0, 3.0, 2.5}}};
  for (const Case& c : kCases) {
    const Layer layer({1.0, c.nu, 1.0});
    const Fields expected = integrated_fields(c.nu, 1.0, c.a, c.r);
    const auto size = sizes(layer, c.a);
    const auto got = all_fields(layer, c.a, c.r);
    const std::array<double, 7> want{expected.dome.mean, expected.dome.fan, expected.punch.mean, expected.punch.fan,
                                     expected.torque,    expected.outward,  expected.sink};
    for (std::size_t i = 0; i < got.size(); ++i) DOUBLES_EQUAL(want[i], got[i], 1e-4 * size[i]);
  }
}

TEST(Layer, HalfSpaceFormsAreTheHankelIntegralsToo) {
  for (const double r : {0.0, 0.4, 0.8, 1.3, 4.0}) {
    const Layer layer({1.0, 0.3, kInfinity});
    const Fields expected = integrated_fields(0.3, kInfinity, 1.0, r);
    DOUBLES_EQUAL(expected.torque, layer.torque(1.0, r), 1e-4 * layer.torque(1.0, 1.0));
    DOUBLES_EQUAL(expected.outward, layer.press_outward(1.0, r), 1e-4 * std::abs(layer.press_outward(1.0, 1.0)));
    DOUBLES_EQUAL(expected.sink, layer.press_sink(1.0, r), 1e-4 * layer.press_sink(1.0, 0.0));
  }
}

// The tables' own error: the difference alone converges fast and has an oracle of 1e-9.
TEST(Layer, TablesAreGoodToAHundredThousandthOfTheField) {
  double worst = 0.0;
  for (const double nu : {0.0, 0.49, 0.5}) {
    const Layer layer({1.0, nu, 1.0});
    const Layer half({1.0, nu, kInfinity});
    for (const double a : {0.06, 0.31, 1.57, 2.68, 3.93}) {
      const auto size = sizes(layer, a);
      for (const double r : {0.0, 0.05, 0.7, 1.81, 3.3, 6.06, 11.95}) {
        const auto difference = [&](int order, const auto& kernel) {
          return integral(18.0, 0.25, [&](double k) { return kernel(k) * bessel_j(order, k * r) * k; });
        };
        const auto minus = [&](double k) {
          const LayerCompliance l = textbook(nu, 1.0, k);
          const LayerCompliance h = textbook(nu, kInfinity, k);
          return LayerCompliance{l.along - h.along, l.across - h.across, l.normal - h.normal, l.coupling - h.coupling};
        };
        const auto dome = [&](double k) { return a * a * std::sph_bessel(1, k * a) / k; };
        const auto punch = [&](double k) { return std::sph_bessel(0, k * a) / (2.0 * pi); };
        const auto base = all_fields(half, a, r);
        const auto got = all_fields(layer, a, r);
        const std::array<double, 7> want{
            difference(0, [&](double k) { return 0.5 * (minus(k).along + minus(k).across) * dome(k); }),
            difference(2, [&](double k) { return 0.5 * (minus(k).across - minus(k).along) * dome(k); }),
            difference(0, [&](double k) { return 0.5 * (minus(k).along + minus(k).across) * punch(k); }),
            difference(2, [&](double k) { return 0.5 * (minus(k).across - minus(k).along) * punch(k); }),
            difference(1, [&](double k) { return minus(k).across * 3.0 / (4.0 * pi * a) * std::sph_bessel(1, k * a); }),
            difference(1, [&](double k) { return -minus(k).coupling * dome(k); }),
            difference(0, [&](double k) { return minus(k).normal * dome(k); })};
        for (std::size_t i = 0; i < got.size(); ++i) {
          worst = std::max(worst, std::abs(got[i] - base[i] - want[i]) / size[i]);
        }
      }
    }
  }
  CHECK(worst < 1e-5);
  CHECK(worst > 1e-7);  // a bound that could be tighter by two digits says nothing
}

TEST(Layer, InfiniteThicknessIsTheHalfSpaceBitForBit) {
  const Gel gel{0.07, 0.45, kInfinity};
  const Layer layer(gel);
  for (const double r : {0.0, 1.0, 2.5, 3.0, 4.0, 200.0}) {
    const double d = r * std::numbers::sqrt2 / 2.0;
    const Vec2 dome = dome_field_mm(gel, 3.0, 1.0, {d, d});
    const Vec2 punch = stuck_field_mm(gel, 3.0, 1.0, {d, d});
    CHECK(dome.x == layer.dome(3.0, r).mean && dome.y == layer.dome(3.0, r).fan);
    CHECK(punch.x == layer.punch(3.0, r).mean && punch.y == layer.punch(3.0, r).fan);
    CHECK(layer.point(r).mean == 0.0 && layer.point(r).sink == 0.0);
  }
  const Press expected = press_sphere(gel, 8.0, 5.0);
  const Press press = layer.press_by_force(8.0, 5.0);
  CHECK(expected.force_n == press.force_n && expected.depth_mm == press.depth_mm);
  CHECK(expected.contact_radius_mm == press.contact_radius_mm && expected.peak_pressure_mpa == press.peak_pressure_mpa);
  DOUBLES_EQUAL(5.0, layer.press_by_depth(8.0, expected.depth_mm).force_n, 1e-13);
  // Very thick is the same but for rounding.
  const Layer thick({0.07, 0.45, 1e9});
  check_near(layer.dome(3.0, 2.0), thick.dome(3.0, 2.0), 1e-8 * layer.dome(3.0, 0.0).mean);
  DOUBLES_EQUAL(expected.contact_radius_mm, thick.press_by_force(8.0, 5.0).contact_radius_mm, 1e-8);
}

TEST(Layer, ManyAtOnceAreTheSame) {
  std::vector<double> r;
  for (double at = 0.0; at < 80.0; at += 0.3701) r.push_back(at);
  for (const double h : {0.3, 1.0, 4.25, 1e6, kInfinity}) {
    const Layer layer({0.1, 0.49, h});
    for (const double a : {0.0, 0.01, 0.37, 2.5, 4.1, 25.0}) {
      std::vector<double> mean(r.size(), -1.0);
      std::vector<double> fan(r.size(), -1.0);
      layer.dome(a, r, mean, fan);
      // 1e-11 of the half-space's centre value: what the layer's own is the small rest of.
      const Layer half({0.1, 0.49, kInfinity});
      for (std::size_t i = 0; i < r.size(); ++i) {
        check_near(layer.dome(a, r[i]), {mean[i], fan[i]}, 1e-11 * half.dome(a, 0.0).mean);
      }
      layer.punch(a, r, mean, fan);
      for (std::size_t i = 0; i < r.size(); ++i) {
        check_near(layer.punch(a, r[i]), {mean[i], fan[i]}, 1e-11 * half.punch(a, 0.0).mean);
      }
    }
  }
  const Layer layer({0.1, 0.49, 4.25});
  layer.dome(1.0, {}, {}, {});  // none at all
}

TEST(Layer, PointKernelIsTheSmallestPunch) {
  for (const double nu : kPoissons) {
    const Layer layer({0.3, nu, 2.0});
    const Layer half({0.3, nu, kInfinity});
    const double size = -layer.point(0.0).mean;
    CHECK(size > 0.0);
    CHECK(layer.point(0.0).fan == 0.0 || std::abs(layer.point(0.0).fan) < 1e-6 * size);
    CHECK(std::abs(layer.point(0.0).outward) < 1e-6 * size);
    for (const double r : {0.0, 0.01, 0.7, 3.0, 20.0, 23.9, 24.1, 40.0}) {
      constexpr double kSmall = 1e-3;  // mm; a force spread on it is a point's to (a/h)^2
      const LayerPoint point = layer.point(r);
      const Spread thick = half.punch(kSmall, r);
      const Spread thin = layer.punch(kSmall, r);
      check_near({thin.mean - thick.mean, thin.fan - thick.fan}, {point.mean, point.fan}, 1e-6 * size);
      const double force = 2.0 / 3.0 * pi * kSmall * kSmall * kSmall;
      DOUBLES_EQUAL((layer.press_outward(kSmall, r) - half.press_outward(kSmall, r)) / force, point.outward,
                    1e-6 * size);
      DOUBLES_EQUAL((layer.press_sink(kSmall, r) - half.press_sink(kSmall, r)) / force, point.sink, 1e-6 * size);
    }
  }
}

TEST(Layer, CopiesShareTheTablesAndOutliveTheOriginal) {
  const Layer copy = [] {
    const Layer original({0.1, 0.49, 4.25});
    return Layer(original);
  }();
  const Layer fresh({0.1, 0.49, 4.25});
  CHECK(fresh.dome(2.0, 1.0).mean == copy.dome(2.0, 1.0).mean);
}

TEST(Layer, SphereAgreesWithCollocation) {
  struct Case {
    double nu;
    double a;
    double tolerance;  // relative; five terms describe a thin layer's pressure less well
  };
  for (const Case& c : {Case{0.2, 1.3, 1e-4}, Case{0.5, 1.3, 1e-4}, Case{0.5, 2.0, 1e-3}}) {
    const PressRatio expected = collocated(c.nu, c.a);
    const PressRatio ratio = Layer({1.0, c.nu, 1.0}).press_ratio(c.a);
    DOUBLES_EQUAL(expected.force, ratio.force, c.tolerance * expected.force);
    DOUBLES_EQUAL(expected.depth, ratio.depth, c.tolerance * expected.depth);
    DOUBLES_EQUAL(expected.peak_pressure, ratio.peak_pressure, c.tolerance * expected.peak_pressure);
  }
}

TEST(Layer, ForceAndDepthOfASphereAreOneCurve) {
  for (const double nu : kPoissons) {
    const Layer layer({0.05, nu, 1.5});
    const Layer half({0.05, nu, kInfinity});
    double last = 0.0;
    for (double force = 1e-12; force < 1e12; force *= 7.3) {
      const Press press = layer.press_by_force(12.0, force);
      const Press back = layer.press_by_depth(12.0, press.depth_mm);
      CHECK_EQUAL(force, press.force_n);
      DOUBLES_EQUAL(1.0, back.force_n / force, 1e-11);
      DOUBLES_EQUAL(1.0, back.contact_radius_mm / press.contact_radius_mm, 1e-11);
      CHECK(press.contact_radius_mm > last);
      CHECK(press.contact_radius_mm <= half.press_by_force(12.0, force).contact_radius_mm * (1.0 + 1e-12));
      CHECK(press.peak_pressure_mpa > 1.49 * force / (pi * press.contact_radius_mm * press.contact_radius_mm));
      last = press.contact_radius_mm;
    }
    for (const double none : {0.0, -1.0}) {
      CHECK_EQUAL(0.0, layer.press_by_force(12.0, none).contact_radius_mm);
      CHECK_EQUAL(0.0, layer.press_by_depth(12.0, none).contact_radius_mm);
      CHECK_EQUAL(0.0, layer.press_by_depth(none, 1.0).contact_radius_mm);
    }
    CHECK_EQUAL(0.0, layer.press_by_depth(kInfinity, 1.0).contact_radius_mm);
    CHECK_EQUAL(0.0, layer.press_by_force(kInfinity, 1.0).contact_radius_mm);
  }
}

TEST(Layer, NoInputOfTheRangeGivesNaN) {
  constexpr std::array<double, 8> kLengths{0.0, 1e-40, 1e-6, 0.5, 3.0, 50.0, 1e6, 1e40};
  for (const double nu : {0.0, 0.5}) {
    for (const double h : {0.0, 1e-40, 1e-6, 4.25, 1e40, 1e300, kInfinity}) {
      for (const double modulus : {1e-40, 0.035, 1e40}) {
        const Layer layer({modulus, nu, h});
        for (const double a : kLengths) {
          for (const double r : kLengths) {
            for (const double value : all_fields(layer, a, r)) CHECK(!std::isnan(value));
            if (a == 0.0 || h == 0.0) {
              for (const double value : all_fields(layer, a, r)) CHECK_EQUAL(0.0, value);
            }
            const LayerPoint point = layer.point(r);
            for (const double value : {point.mean, point.fan, point.outward, point.sink}) CHECK(!std::isnan(value));
          }
          const PressRatio ratio = layer.press_ratio(a);
          for (const double value : {ratio.force, ratio.depth, ratio.peak_pressure}) CHECK(!std::isnan(value));
          for (const double size : kLengths) {
            for (const Press& press : {layer.press_by_force(size, a), layer.press_by_depth(size, a)}) {
              for (const double value :
                   {press.force_n, press.contact_radius_mm, press.depth_mm, press.peak_pressure_mpa}) {
                CHECK(!std::isnan(value));
              }
            }
          }
        }
      }
    }
  }
  // G scales everything and nothing else.
  const Layer soft({1e-6, 0.49, 4.25});
  const Layer hard({1e6, 0.49, 4.25});
  DOUBLES_EQUAL(1.0, soft.dome(3.0, 2.0).mean / hard.dome(3.0, 2.0).mean / 1e12, 1e-14);
}
