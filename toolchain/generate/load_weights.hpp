// SPDX-License-Identifier: Apache-2.0
// The weights by which the firmware reads forces out of the displacement field (tactile/load.hpp), from the layer's
// closed form alone: the best linear estimate over contacts drawn at random.
//
// A contact is a pressure and shear tractions on an ellipse, without any law that ties them together:
//   place       centre within +-6 x +-4.5 mm, any turn, cut off at the edge of the pad (25.2 x 20.7 mm)
//   size        half axes 1.2 to 7 mm, alike in a third of them; another third is a bar, 3 to 100 mm by 0.8 to 3.5 mm
//   pressure    1 N in all, spread as a dome (sphere) or evenly (flat)
//   held back   0 to 1.1 times the tractions that would keep the gel under it from flowing out at all
//   shear       0 to 1 N in any direction, spread as the pressure, evenly, or between; a twist in three of ten
// and 4 um of noise on each marker: twice the tracker's, for gels twice as stiff. The fields come from `Layer`, whose
// domes cover the contact.
//
// Weights of figures with another symmetry are 0, so each is a small problem of its own. The normal load's depend on
// the direction of the shear, which the shear's own weights say; two rounds settle which force decides how much.
#pragma once

#include <string>

namespace holdfast::load_weights {

// firmware/tactile/load_weights.gen.hpp. Takes 20 s.
[[nodiscard]] std::string header();

}  // namespace holdfast::load_weights
