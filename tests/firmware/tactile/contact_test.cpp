// SPDX-License-Identifier: Apache-2.0
#include "tactile/contact.hpp"

#include <CppUTest/TestHarness.h>

using namespace holdfast;

namespace {

// `dots` markers lie `um` from their rest position, the others 10 um.
DisplacementField field_of(int dots, int um) {
  DisplacementField field;
  field.grid = {7, 9};
  for (int i = 0; i < field.grid.count(); ++i) {
    const int x = i < dots ? um : 10;
    field.markers[idx(i)] = {Micrometres::from_raw(i % 2 == 0 ? x : 0), Micrometres::from_raw(i % 2 == 0 ? 0 : -x),
                             true};
  }
  return field;
}

struct Gate {
  contact::Contact see(int patches, int dots = 0, int um = 0) {
    now += Micros{40'000};
    return contact::update(state, config, field_of(dots, um), Count::from_raw(patches), opening, now);
  }
  contact::Contact wait(int frames, int patches, int dots = 0, int um = 0) {
    contact::Contact last;
    for (int k = 0; k < frames; ++k) last = see(patches, dots, um);
    return last;
  }

  contact::Config config;
  contact::State state;
  bool opening = false;
  Micros now{0};
};

}  // namespace

TEST_GROUP(Contact){};

TEST(Contact, NothingTouchesAnEmptyGel) {
  Gate gate;
  for (int k = 0; k < 100; ++k) {
    const contact::Contact now = gate.see(4, 2, 3000);  // four patches of noise, two strays
    CHECK_FALSE(now.touching);
    CHECK(now.event == contact::Event::kNone);
    CHECK(gate.state.empty);
  }
}

TEST(Contact, EitherWitnessIsEnoughWhenItLasts) {
  for (const bool by_relief : {true, false}) {
    Gate gate;
    (void)gate.wait(20, 0);
    const auto see = [&] { return by_relief ? gate.see(5) : gate.see(0, 3, 81); };
    CHECK_FALSE(see().touching);
    CHECK_FALSE(gate.state.empty);
    const contact::Contact touched = see();
    CHECK(touched.touching);
    CHECK(touched.event == contact::Event::kTouched);
    CHECK(see().event == contact::Event::kNone);
  }
  // A single frame of it is a flicker.
  Gate gate;
  (void)gate.wait(20, 0);
  for (int k = 0; k < 20; ++k) {
    CHECK_FALSE(gate.see(200).touching);
    CHECK_FALSE(gate.see(0).touching);
  }
}

TEST(Contact, EndsWhenBothHaveBeenSilentForLong) {
  Gate gate;
  (void)gate.wait(20, 0);
  CHECK(gate.wait(5, 100, 10, 500).touching);
  CHECK(gate.wait(50, 3).touching);         // the relief is still there
  CHECK(gate.wait(50, 0, 3, 61).touching);  // then dots only
  CHECK(gate.wait(3, 0).touching);          // 80 ms
  CHECK(gate.see(3).touching);              // a last flicker starts the time again
  CHECK(gate.wait(3, 0).touching);
  const contact::Contact lost = gate.see(0);
  CHECK_FALSE(lost.touching);
  CHECK(lost.event == contact::Event::kLost);
  CHECK(gate.see(0).event == contact::Event::kNone);
}

TEST(Contact, EndsInTimeAfterTheClockStepsBack) {
  Gate gate;
  gate.now = Micros{3'600'000'000};
  CHECK(gate.wait(20, 100, 10, 500).touching);
  CHECK(gate.see(0).touching);
  gate.now = Micros{0};
  CHECK(gate.wait(3, 0).touching);
  CHECK(gate.see(0).event == contact::Event::kLost);
}

TEST(Contact, WhatIsLetGoIsNotLost) {
  Gate gate;
  (void)gate.wait(20, 100);
  gate.opening = true;
  CHECK(gate.see(100).touching);
  CHECK(gate.wait(4, 0).event == contact::Event::kReleased);
  gate.opening = false;
  (void)gate.wait(20, 100);
  CHECK(gate.wait(4, 0).event == contact::Event::kLost);
}

// What a grip leaves in the gel is small and moves no dots. It touches, as far as can be seen, but cannot be lost.
TEST(Contact, WhatNeverWasFirmIsNotLost) {
  Gate gate;
  CHECK(gate.wait(20, 9).touching);
  CHECK(gate.wait(4, 0).event == contact::Event::kFaded);
  CHECK_FALSE(gate.state.touching);
  for (const bool dots : {false, true}) {  // either makes it firm, in one frame, and for as long as it lasts
    CHECK(gate.wait(20, 9).touching);
    (void)(dots ? gate.see(0, 3, 81) : gate.see(10));
    (void)gate.wait(20, 4);
    CHECK(gate.wait(4, 0).event == contact::Event::kLost);
  }
  CHECK(gate.wait(20, 9).touching);  // and no longer
  CHECK(gate.wait(4, 0).event == contact::Event::kFaded);
  CHECK(gate.wait(20, 9).touching);
  gate.opening = true;
  CHECK(gate.wait(4, 0).event == contact::Event::kReleased);
}

// The gel creeps back, and a hand may come again: half a second before its picture is learned.
TEST(Contact, EmptyOnlyAfterHalfASecond) {
  Gate gate;
  (void)gate.wait(20, 0);
  CHECK(gate.state.empty);
  (void)gate.wait(5, 100);
  CHECK_FALSE(gate.state.empty);
  (void)gate.wait(4, 0);
  CHECK_FALSE(gate.state.touching);
  CHECK_FALSE(gate.state.empty);
  (void)gate.wait(11, 0);
  CHECK_FALSE(gate.state.empty);
  (void)gate.wait(3, 0);
  CHECK(gate.state.empty);
}

TEST(Contact, WhatTheFirstFrameSaysCounts) {
  Gate gate;
  CHECK(gate.see(100).touching);
  contact::forget(gate.state);
  CHECK_FALSE(gate.see(0).touching);
  CHECK(gate.state.empty);
}

TEST(Contact, LostDotsAndExtremes) {
  Gate gate;
  DisplacementField field = field_of(63, 65535);
  CHECK(contact::displaced(field, 80));
  for (MarkerDisplacement& d : field.markers) d.valid = false;
  CHECK_FALSE(contact::displaced(field, 80));
  for (MarkerDisplacement& d : field.markers) {
    d = {Micrometres::from_raw(Micrometres::kMin), Micrometres::from_raw(Micrometres::kMax), true};
  }
  CHECK(contact::displaced(field, 80));
  CHECK_FALSE(contact::displaced(field_of(0, 0), 10));  // further than, not as far as
  CHECK(contact::displaced(field_of(0, 0), 9));
}

// Wherever they are.
TEST(Contact, AnyThreeMarkersAreEnough) {
  for (int first = 0; first < 61; ++first) {
    DisplacementField field = field_of(0, 0);
    for (const int i : {first, first + 1, 62}) field.markers[idx(i)].dx = Micrometres::from_raw(200);
    CHECK(contact::displaced(field, 100));
    field.markers[idx(first)].valid = false;
    CHECK_FALSE(contact::displaced(field, 100));
  }
}
