// SPDX-License-Identifier: Apache-2.0
// Generated from toolchain/model/slip_v6.tree; do not edit. holdfast compile writes it.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "slip/tree_io.hpp"

namespace holdfast::slip_tree {

inline constexpr std::string_view kName = "slip_v6";
inline constexpr std::string_view kFeatureSet = "grasp";
inline constexpr int kDepth = 21;
inline constexpr int kNodes = 427;
inline constexpr std::uint32_t kModelCrc32 = 0x8FEED8D9;  // of the model's text

// The first predicate on each feature.
// clang-format off
inline constexpr std::array<Predicate, 18> kFirst{{
    {13, 1480},  // imprint_log2_um_q8
    {15, 1512},  // imprint_coarse_log2_um_q8
    {18, 205},  // imprint_turnover_q10
    {16, 9},  // imprint_patches
    {7, 150},  // flow_residual_um_s
    {4, 120473},  // octave_entropy_nat_q16
    {3, 754},  // evenness_q10
    {2, 60},  // unevenness_log2_q8
    {1, 6576},  // residual_um_q4
    {9, 321},  // flow_along_q10
    {11, 387},  // dilation_rate_ppm_s
    {10, -388},  // flow_steady_q10
    {8, 555},  // flow_evenness_q10
    {6, 54},  // flow_spread_um_s
    {0, 231},  // reach_um
    {5, -79},  // residual_rate_um_s
    {12, 10718},  // easing_ppm_s
    {14, 64},  // imprint_growth_log2_q8
}};
// clang-format on

[[nodiscard]] constexpr Verdict evaluate(const std::array<std::int32_t, 19>& x) {
  const std::int32_t& reach_um = x[0];
  const std::int32_t& residual_um_q4 = x[1];
  const std::int32_t& unevenness_log2_q8 = x[2];
  const std::int32_t& evenness_q10 = x[3];
  const std::int32_t& octave_entropy_nat_q16 = x[4];
  const std::int32_t& residual_rate_um_s = x[5];
  const std::int32_t& flow_spread_um_s = x[6];
  const std::int32_t& flow_residual_um_s = x[7];
  const std::int32_t& flow_evenness_q10 = x[8];
  const std::int32_t& flow_along_q10 = x[9];
  const std::int32_t& flow_steady_q10 = x[10];
  const std::int32_t& dilation_rate_ppm_s = x[11];
  const std::int32_t& easing_ppm_s = x[12];
  const std::int32_t& imprint_log2_um_q8 = x[13];
  const std::int32_t& imprint_growth_log2_q8 = x[14];
  const std::int32_t& imprint_coarse_log2_um_q8 = x[15];
  const std::int32_t& imprint_patches = x[16];
  const std::int32_t& imprint_turnover_q10 = x[18];
  if (imprint_log2_um_q8 <= 1480) {
    if (imprint_coarse_log2_um_q8 <= 1512) {
      if (imprint_turnover_q10 <= 205) {
        if (imprint_patches <= 9) {
          if (flow_residual_um_s <= 150) return Verdict::kHold;
          if (octave_entropy_nat_q16 <= 120473) {
            if (octave_entropy_nat_q16 <= 107942) return Verdict::kHold;
            if (evenness_q10 <= 754) {
              if (unevenness_log2_q8 <= 60) {
                if (residual_um_q4 <= 6576) {
                  if (flow_along_q10 <= 321) {
                    if (flow_along_q10 <= -180) return Verdict::kHold;
                    if (dilation_rate_ppm_s <= 387) {
                      if (evenness_q10 <= 722) {
                        if (flow_steady_q10 <= -388) {
                          if (unevenness_log2_q8 <= 11) return Verdict::kHold;
                          return Verdict::kSlip;
                        }
                        return Verdict::kSlip;
                      }
                      return Verdict::kHold;
                    }
                    return Verdict::kSlip;
                  }
                  if (flow_evenness_q10 <= 555) return Verdict::kSlip;
                  return Verdict::kHold;
                }
                return Verdict::kHold;
              }
              if (evenness_q10 <= 599) {
                if (flow_spread_um_s <= 54) return Verdict::kHold;
                return Verdict::kSlip;
              }
              return Verdict::kHold;
            }
            if (reach_um <= 231) return Verdict::kHold;
            if (flow_steady_q10 <= 50) return Verdict::kHold;
            if (dilation_rate_ppm_s <= 371) return Verdict::kHold;
            if (flow_evenness_q10 <= 739) {
              if (unevenness_log2_q8 <= -100) {
                if (flow_spread_um_s <= 422) return Verdict::kSlip;
                return Verdict::kHold;
              }
              if (residual_um_q4 <= 3317) return Verdict::kHold;
              return Verdict::kSlip;
            }
            return Verdict::kHold;
          }
          if (dilation_rate_ppm_s <= 371) {
            if (flow_steady_q10 <= -315) {
              if (residual_um_q4 <= 892) {
                if (flow_evenness_q10 <= 332) return Verdict::kHold;
                if (evenness_q10 <= 709) {
                  if (flow_spread_um_s <= 108) return Verdict::kHold;
                  if (flow_evenness_q10 <= 477) return Verdict::kSlip;
                  if (residual_rate_um_s <= -79) return Verdict::kHold;
                  if (residual_um_q4 <= 658) return Verdict::kSlip;
                  return Verdict::kHold;
                }
                return Verdict::kHold;
              }
              return Verdict::kHold;
            }
            if (flow_evenness_q10 <= 481) {
              if (flow_steady_q10 <= 559) {
                if (flow_spread_um_s <= 734) {
                  if (dilation_rate_ppm_s <= -2963) {
                    if (flow_along_q10 <= -815) return Verdict::kSlip;
                    if (flow_along_q10 <= -47) return Verdict::kHold;
                    if (flow_evenness_q10 <= 410) {
                      if (flow_spread_um_s <= 160) return Verdict::kHold;
                      return Verdict::kSlip;
                    }
                    return Verdict::kHold;
                  }
                  if (evenness_q10 <= 675) {
                    if (unevenness_log2_q8 <= -28) return Verdict::kSlip;
                    if (unevenness_log2_q8 <= 301) {
                      if (flow_along_q10 <= 315) {
                        if (dilation_rate_ppm_s <= -413) return Verdict::kHold;
                        return Verdict::kSlip;
                      }
                      return Verdict::kSlip;
                    }
                    return Verdict::kHold;
                  }
                  return Verdict::kHold;
                }
                return Verdict::kHold;
              }
              if (flow_spread_um_s <= 562) {
                if (flow_evenness_q10 <= 436) {
                  if (reach_um <= 392) {
                    if (flow_along_q10 <= 387) return Verdict::kSlip;
                    if (unevenness_log2_q8 <= 210) {
                      if (easing_ppm_s <= 10718) {
                        if (flow_evenness_q10 <= 399) return Verdict::kSlip;
                        if (dilation_rate_ppm_s <= -304) return Verdict::kHold;
                        return Verdict::kSlip;
                      }
                      return Verdict::kHold;
                    }
                    return Verdict::kHold;
                  }
                  return Verdict::kSlip;
                }
                if (unevenness_log2_q8 <= 31) {
                  if (dilation_rate_ppm_s <= -2371) return Verdict::kHold;
                  return Verdict::kSlip;
                }
                if (evenness_q10 <= 421) return Verdict::kSlip;
                if (flow_along_q10 <= 978) {
                  if (residual_um_q4 <= 1862) return Verdict::kHold;
                  if (dilation_rate_ppm_s <= -1267) return Verdict::kHold;
                  if (unevenness_log2_q8 <= 230) return Verdict::kSlip;
                  return Verdict::kHold;
                }
                return Verdict::kHold;
              }
              if (evenness_q10 <= 434) return Verdict::kSlip;
              return Verdict::kHold;
            }
            if (flow_along_q10 <= 192) {
              if (easing_ppm_s <= 107) {
                if (flow_along_q10 <= -275) return Verdict::kHold;
                if (unevenness_log2_q8 <= 249) {
                  if (flow_spread_um_s <= 28) {
                    if (reach_um <= 289) return Verdict::kSlip;
                    if (easing_ppm_s <= 53) return Verdict::kSlip;
                    return Verdict::kHold;
                  }
                  return Verdict::kSlip;
                }
                return Verdict::kHold;
              }
              if (residual_um_q4 <= 3469) {
                if (evenness_q10 <= 731) {
                  if (flow_steady_q10 <= 109) {
                    if (flow_along_q10 <= -970) {
                      if (dilation_rate_ppm_s <= -2550) return Verdict::kSlip;
                      return Verdict::kHold;
                    }
                    return Verdict::kHold;
                  }
                  if (flow_along_q10 <= -291) {
                    if (flow_steady_q10 <= 963) {
                      if (flow_along_q10 <= -986) {
                        if (dilation_rate_ppm_s <= -3829) {
                          if (flow_steady_q10 <= 766) return Verdict::kSlip;
                          return Verdict::kHold;
                        }
                        return Verdict::kHold;
                      }
                      return Verdict::kHold;
                    }
                    return Verdict::kHold;
                  }
                  if (easing_ppm_s <= 1956) {
                    if (unevenness_log2_q8 <= 15) {
                      if (flow_spread_um_s <= 13) return Verdict::kHold;
                      if (flow_evenness_q10 <= 665) return Verdict::kSlip;
                      if (flow_spread_um_s <= 74) {
                        if (flow_evenness_q10 <= 777) return Verdict::kSlip;
                        return Verdict::kHold;
                      }
                      return Verdict::kHold;
                    }
                    if (evenness_q10 <= 653) {
                      if (residual_rate_um_s <= -17) return Verdict::kHold;
                      if (flow_along_q10 <= 53) return Verdict::kSlip;
                      return Verdict::kHold;
                    }
                    return Verdict::kHold;
                  }
                  if (evenness_q10 <= 537) {
                    if (residual_rate_um_s <= -49) return Verdict::kHold;
                    if (flow_steady_q10 <= 447) return Verdict::kHold;
                    return Verdict::kSlip;
                  }
                  return Verdict::kHold;
                }
                return Verdict::kHold;
              }
              return Verdict::kHold;
            }
            if (flow_spread_um_s <= 38) return Verdict::kHold;
            if (flow_residual_um_s <= 530) {
              if (unevenness_log2_q8 <= -87) {
                if (flow_evenness_q10 <= 708) {
                  if (flow_evenness_q10 <= 615) {
                    if (dilation_rate_ppm_s <= -4796) return Verdict::kHold;
                    return Verdict::kSlip;
                  }
                  if (flow_steady_q10 <= 1008) {
                    if (flow_along_q10 <= 940) return Verdict::kHold;
                    if (unevenness_log2_q8 <= -142) {
                      if (dilation_rate_ppm_s <= -6130) return Verdict::kHold;
                      return Verdict::kSlip;
                    }
                    return Verdict::kHold;
                  }
                  return Verdict::kHold;
                }
                return Verdict::kHold;
              }
              return Verdict::kHold;
            }
            return Verdict::kHold;
          }
          if (flow_spread_um_s <= 459) {
            if (flow_steady_q10 <= -160) {
              if (easing_ppm_s <= 170) {
                if (flow_along_q10 <= -169) {
                  if (flow_evenness_q10 <= 510) return Verdict::kSlip;
                  return Verdict::kHold;
                }
                if (flow_along_q10 <= 198) {
                  if (unevenness_log2_q8 <= 168) return Verdict::kSlip;
                  return Verdict::kHold;
                }
                return Verdict::kHold;
              }
              if (flow_steady_q10 <= -926) return Verdict::kHold;
              if (flow_evenness_q10 <= 494) return Verdict::kSlip;
              if (flow_along_q10 <= -848) return Verdict::kHold;
              if (easing_ppm_s <= 3426) {
                if (unevenness_log2_q8 <= 95) {
                  if (flow_along_q10 <= 249) {
                    if (flow_along_q10 <= -550) return Verdict::kHold;
                    return Verdict::kSlip;
                  }
                  return Verdict::kHold;
                }
                return Verdict::kHold;
              }
              return Verdict::kHold;
            }
            if (flow_along_q10 <= 275) {
              if (flow_along_q10 <= -342) {
                if (flow_evenness_q10 <= 526) {
                  if (flow_along_q10 <= -585) return Verdict::kHold;
                  if (reach_um <= 312) return Verdict::kHold;
                  return Verdict::kSlip;
                }
                return Verdict::kHold;
              }
              if (unevenness_log2_q8 <= 199) {
                if (easing_ppm_s <= 141) return Verdict::kSlip;
                if (flow_steady_q10 <= 179) {
                  if (dilation_rate_ppm_s <= 796) {
                    if (flow_evenness_q10 <= 509) return Verdict::kHold;
                    if (residual_um_q4 <= 2890) {
                      if (easing_ppm_s <= 1968) {
                        if (flow_along_q10 <= 137) {
                          if (unevenness_log2_q8 <= 32) {
                            if (octave_entropy_nat_q16 <= 141775) return Verdict::kSlip;
                            return Verdict::kHold;
                          }
                          return Verdict::kSlip;
                        }
                        return Verdict::kHold;
                      }
                      return Verdict::kHold;
                    }
                    return Verdict::kHold;
                  }
                  if (residual_um_q4 <= 1422) {
                    if (unevenness_log2_q8 <= -86) return Verdict::kSlip;
                    if (residual_rate_um_s <= -1) return Verdict::kHold;
                    if (reach_um <= 222) return Verdict::kSlip;
                    return Verdict::kHold;
                  }
                  if (flow_evenness_q10 <= 788) return Verdict::kSlip;
                  return Verdict::kHold;
                }
                if (residual_rate_um_s <= -4) {
                  if (octave_entropy_nat_q16 <= 154090) {
                    if (unevenness_log2_q8 <= -83) {
                      if (residual_um_q4 <= 1011) return Verdict::kHold;
                      return Verdict::kSlip;
                    }
                    if (evenness_q10 <= 663) {
                      if (easing_ppm_s <= 1757) {
                        if (flow_evenness_q10 <= 467) return Verdict::kSlip;
                        if (residual_rate_um_s <= -15) return Verdict::kHold;
                        return Verdict::kSlip;
                      }
                      return Verdict::kHold;
                    }
                    return Verdict::kHold;
                  }
                  return Verdict::kSlip;
                }
                if (flow_along_q10 <= 125) {
                  if (dilation_rate_ppm_s <= 754) {
                    if (residual_um_q4 <= 4129) return Verdict::kSlip;
                    return Verdict::kHold;
                  }
                  return Verdict::kSlip;
                }
                if (flow_spread_um_s <= 142) {
                  if (dilation_rate_ppm_s <= 1237) {
                    if (residual_um_q4 <= 3555) {
                      if (reach_um <= 163) return Verdict::kHold;
                      return Verdict::kSlip;
                    }
                    return Verdict::kHold;
                  }
                  return Verdict::kSlip;
                }
                if (reach_um <= 599) {
                  if (flow_evenness_q10 <= 459) return Verdict::kSlip;
                  if (unevenness_log2_q8 <= -44) {
                    if (flow_evenness_q10 <= 647) return Verdict::kSlip;
                    return Verdict::kHold;
                  }
                  return Verdict::kHold;
                }
                return Verdict::kSlip;
              }
              if (reach_um <= 218) return Verdict::kHold;
              if (flow_evenness_q10 <= 472) return Verdict::kSlip;
              if (unevenness_log2_q8 <= 264) return Verdict::kSlip;
              return Verdict::kHold;
            }
            if (flow_evenness_q10 <= 482) {
              if (reach_um <= 383) {
                if (unevenness_log2_q8 <= 121) {
                  if (flow_evenness_q10 <= 441) return Verdict::kSlip;
                  if (evenness_q10 <= 603) return Verdict::kHold;
                  return Verdict::kSlip;
                }
                return Verdict::kHold;
              }
              return Verdict::kSlip;
            }
            if (reach_um <= 315) {
              if (unevenness_log2_q8 <= -42) {
                if (flow_evenness_q10 <= 692) {
                  if (unevenness_log2_q8 <= -84) return Verdict::kSlip;
                  if (flow_evenness_q10 <= 603) return Verdict::kSlip;
                  return Verdict::kHold;
                }
                return Verdict::kHold;
              }
              return Verdict::kHold;
            }
            if (unevenness_log2_q8 <= -73) {
              if (flow_evenness_q10 <= 690) return Verdict::kSlip;
              return Verdict::kHold;
            }
            if (flow_evenness_q10 <= 572) {
              if (flow_along_q10 <= 968) {
                if (reach_um <= 440) {
                  if (unevenness_log2_q8 <= -13) return Verdict::kSlip;
                  if (residual_rate_um_s <= 51) return Verdict::kSlip;
                  return Verdict::kHold;
                }
                if (evenness_q10 <= 432) return Verdict::kHold;
                if (flow_along_q10 <= 660) return Verdict::kSlip;
                if (evenness_q10 <= 545) return Verdict::kHold;
                return Verdict::kSlip;
              }
              return Verdict::kHold;
            }
            if (flow_along_q10 <= 504) {
              if (flow_evenness_q10 <= 717) {
                if (flow_spread_um_s <= 197) {
                  if (dilation_rate_ppm_s <= 2275) {
                    if (residual_um_q4 <= 3169) return Verdict::kSlip;
                    return Verdict::kHold;
                  }
                  return Verdict::kSlip;
                }
                return Verdict::kHold;
              }
              return Verdict::kHold;
            }
            return Verdict::kHold;
          }
          if (easing_ppm_s <= 6174) {
            if (evenness_q10 <= 457) {
              if (flow_along_q10 <= 419) return Verdict::kSlip;
              return Verdict::kHold;
            }
            if (residual_rate_um_s <= -225) return Verdict::kHold;
            if (flow_along_q10 <= 196) {
              if (dilation_rate_ppm_s <= 13154) {
                if (evenness_q10 <= 555) return Verdict::kSlip;
                return Verdict::kHold;
              }
              return Verdict::kSlip;
            }
            if (dilation_rate_ppm_s <= 24496) {
              if (flow_evenness_q10 <= 484) {
                if (flow_spread_um_s <= 990) {
                  if (residual_um_q4 <= 2182) return Verdict::kHold;
                  return Verdict::kSlip;
                }
                return Verdict::kHold;
              }
              return Verdict::kHold;
            }
            if (flow_residual_um_s <= 1421) return Verdict::kSlip;
            return Verdict::kHold;
          }
          if (flow_evenness_q10 <= 466) {
            if (flow_spread_um_s <= 957) {
              if (flow_along_q10 <= 220) return Verdict::kSlip;
              return Verdict::kHold;
            }
            return Verdict::kHold;
          }
          if (evenness_q10 <= 574) {
            if (flow_along_q10 <= 881) {
              if (residual_rate_um_s <= -278) return Verdict::kHold;
              if (flow_along_q10 <= 243) return Verdict::kSlip;
              return Verdict::kHold;
            }
            return Verdict::kHold;
          }
          return Verdict::kHold;
        }
        return Verdict::kHold;
      }
      if (imprint_growth_log2_q8 <= 64) {
        if (imprint_growth_log2_q8 <= -65) return Verdict::kHold;
        return Verdict::kSlipNow;
      }
      return Verdict::kHold;
    }
    if (imprint_growth_log2_q8 <= 96) {
      if (flow_residual_um_s <= 60) {
        if (imprint_turnover_q10 <= 205) return Verdict::kHold;
        if (imprint_growth_log2_q8 <= 64) {
          if (imprint_growth_log2_q8 <= -65) return Verdict::kHold;
          return Verdict::kSlipNow;
        }
        return Verdict::kHold;
      }
      return Verdict::kSlipNow;
    }
    return Verdict::kHold;
  }
  if (imprint_growth_log2_q8 <= 31) return Verdict::kSlipNow;
  if (imprint_turnover_q10 <= 205) return Verdict::kHold;
  if (imprint_growth_log2_q8 <= 64) return Verdict::kSlipNow;
  return Verdict::kHold;
}

}  // namespace holdfast::slip_tree
