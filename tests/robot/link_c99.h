/* SPDX-License-Identifier: Apache-2.0 */
/* What link_c99.c, compiled as C99, makes of the robot's header: functions that a test in C++ can call. */
#ifndef HOLDFAST_TESTS_LINK_C99_H
#define HOLDFAST_TESTS_LINK_C99_H

#include "toolchain/robot/holdfast_link.h"

#ifdef __cplusplus
extern "C" {
#endif

int c99_push(holdfast_receiver* receiver, uint8_t byte);
int c99_status(const holdfast_receiver* receiver, holdfast_status* status);
void c99_answer(const holdfast_receiver* receiver, holdfast_answer* answer);
void c99_evidence(const holdfast_receiver* receiver, holdfast_evidence* evidence);
void c99_load(const holdfast_receiver* receiver, holdfast_load* load);
void c99_command(const holdfast_command* command, uint8_t* wire);
int c99_grip_ok(holdfast_grip* grip, uint32_t now_ms);
void c99_grip_update(holdfast_grip* grip, const holdfast_status* status, uint32_t now_ms);
const char* c99_name(char of, uint8_t number); /* of: s(tate), r(eason), c(ommand), a(nswer's result), t(ouch: the
                                                  contact), e(vidence), u(nit), b(asis) */

#ifdef __cplusplus
}
#endif
#endif
