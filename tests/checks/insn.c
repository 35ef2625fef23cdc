// SPDX-License-Identifier: Apache-2.0
// QEMU plugin (API version 1, QEMU 4.2 to 8.x): counts the guest instructions that a program executes.
//
//   qemu-aarch64 -plugin ./insn.so PROGRAM ...     ends with the line "guest instructions: N" on stderr
//
// The count is of the whole program with its start-up, and of all its threads together; a count per frame is
// the difference of two runs (count_instructions.sh). It repeats to about +-20 instructions, since start-up
// depends on the environment and the stack's address. It is a measure of work, not of time: no caches, no
// pipelines. Several threads add without a lock, so counts of threaded programs may fall short; use
// single-threaded programs. Debian ships no qemu-plugin.h, so the few names used are declared here as the
// plugin documentation of QEMU gives them. The package qemu-user takes plugins, qemu-user-static refuses them.
#include <stdint.h>
#include <stdio.h>

#define EXPORT __attribute__((visibility("default")))

typedef uint64_t qemu_plugin_id_t;
struct qemu_plugin_tb;
struct qemu_info_t;
enum qemu_plugin_op { QEMU_PLUGIN_INLINE_ADD_U64 };
void qemu_plugin_register_vcpu_tb_trans_cb(qemu_plugin_id_t id,
                                           void (*callback)(qemu_plugin_id_t, struct qemu_plugin_tb*));
void qemu_plugin_register_vcpu_tb_exec_inline(struct qemu_plugin_tb* block, enum qemu_plugin_op op, void* counter,
                                              uint64_t amount);
void qemu_plugin_register_atexit_cb(qemu_plugin_id_t id, void (*callback)(qemu_plugin_id_t, void*), void* data);
size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb* block);

EXPORT int qemu_plugin_version = 1;

static uint64_t executed;

// Called once per translated block: from then on each run of the block adds its length.
static void on_translation(qemu_plugin_id_t id, struct qemu_plugin_tb* block) {
  (void)id;
  qemu_plugin_register_vcpu_tb_exec_inline(block, QEMU_PLUGIN_INLINE_ADD_U64, &executed, qemu_plugin_tb_n_insns(block));
}

static void on_exit(qemu_plugin_id_t id, void* data) {
  (void)id;
  (void)data;
  fprintf(stderr, "guest instructions: %llu\n", (unsigned long long)executed);
}

EXPORT int qemu_plugin_install(qemu_plugin_id_t id, const struct qemu_info_t* info, int argc, char** argv) {
  (void)info;
  (void)argc;
  (void)argv;
  qemu_plugin_register_vcpu_tb_trans_cb(id, on_translation);
  qemu_plugin_register_atexit_cb(id, on_exit, NULL);
  return 0;
}
