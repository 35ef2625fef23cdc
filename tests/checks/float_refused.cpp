// SPDX-License-Identifier: Apache-2.0
// What the integer gate must refuse: arithmetic on a double at run time. Compiled by a test that expects the error.
double half(int value) {
  return value * 0.5;
}
