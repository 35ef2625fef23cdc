/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/robot/link_c99.h"

int c99_push(holdfast_receiver* receiver, uint8_t byte) {
  return holdfast_link_push(receiver, byte);
}

int c99_status(const holdfast_receiver* receiver, holdfast_status* status) {
  return holdfast_link_status(receiver, status);
}

void c99_answer(const holdfast_receiver* receiver, holdfast_answer* answer) {
  holdfast_link_answer(receiver, answer);
}

void c99_evidence(const holdfast_receiver* receiver, holdfast_evidence* evidence) {
  holdfast_link_evidence(receiver, evidence);
}

void c99_load(const holdfast_receiver* receiver, holdfast_load* load) {
  holdfast_link_load(receiver, load);
}

void c99_command(const holdfast_command* command, uint8_t* wire) {
  holdfast_link_command(command, wire);
}

int c99_grip_ok(holdfast_grip* grip, uint32_t now_ms) {
  return holdfast_grip_ok(grip, now_ms);
}

void c99_grip_update(holdfast_grip* grip, const holdfast_status* status, uint32_t now_ms) {
  holdfast_grip_update(grip, status, now_ms);
}

const char* c99_name(char of, uint8_t number) {
  switch (of) {
    case 's':
      return holdfast_state_name(number);
    case 'r':
      return holdfast_reason_name(number);
    case 'c':
      return holdfast_command_name(number);
    case 't':
      return holdfast_contact_name(number);
    case 'e':
      return holdfast_evidence_name(number);
    case 'b':
      return holdfast_basis_name(number);
    case 'u':
      return holdfast_unit_name(number);
    default:
      return holdfast_result_name(number);
  }
}
