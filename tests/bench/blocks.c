// SPDX-License-Identifier: Apache-2.0
// QEMU plugin (as checks/insn.c): how often each block of a program ran, where it went on, and how many branches a
// predictor would have missed. For one thread.
//
//   qemu-aarch64 -plugin ./blocks.so,out=FILE PROGRAM ...
//
// FILE: a line "mispredicted N"; then for each block "ADDRESS COUNT HEX...", a word of bytes for each instruction, and
// behind " >" its most frequent successor and how often it came.
//
// The predictor: for each block the successor that came last, by its address and once more by the path of the last
// blocks as well; of the two, the one that was right more often there. Processors do better with loops of constant
// length and worse with tables as full as a large program's.
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define EXPORT __attribute__((visibility("default")))

typedef uint64_t qemu_plugin_id_t;
struct qemu_plugin_tb;
struct qemu_plugin_insn;
struct qemu_info_t;
enum qemu_plugin_cb_flags { QEMU_PLUGIN_CB_NO_REGS };
void qemu_plugin_register_vcpu_tb_trans_cb(qemu_plugin_id_t id,
                                           void (*callback)(qemu_plugin_id_t, struct qemu_plugin_tb*));
void qemu_plugin_register_vcpu_tb_exec_cb(struct qemu_plugin_tb* block, void (*callback)(unsigned, void*),
                                          enum qemu_plugin_cb_flags flags, void* data);
void qemu_plugin_register_atexit_cb(qemu_plugin_id_t id, void (*callback)(qemu_plugin_id_t, void*), void* data);
size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb* block);
uint64_t qemu_plugin_tb_vaddr(const struct qemu_plugin_tb* block);
struct qemu_plugin_insn* qemu_plugin_tb_get_insn(const struct qemu_plugin_tb* block, size_t index);
const void* qemu_plugin_insn_data(const struct qemu_plugin_insn* insn);
size_t qemu_plugin_insn_size(const struct qemu_plugin_insn* insn);

EXPORT int qemu_plugin_version = 1;

enum { kSuccessors = 8, kPredictions = 1 << 14 };

struct Block {
  struct Block* next;
  uint64_t address, count;
  struct Block* successor[kSuccessors];
  uint64_t went[kSuccessors];
  char* hex;
};
struct Prediction {
  struct Block* block;
  int sure;
};

static struct Block* blocks;
static struct Block* before;
static uint64_t mispredicted, path;
static struct Prediction by_address[kPredictions], by_path[kPredictions];
static int path_is_better[kPredictions];
static FILE* out;

static void learn(struct Prediction* prediction, struct Block* block) {
  if (prediction->block == block) {
    prediction->sure = 1;
  } else if (prediction->sure) {
    prediction->sure = 0;
  } else {
    prediction->block = block;
  }
}

static void on_block(unsigned processor, void* data) {
  (void)processor;
  struct Block* block = data;
  ++block->count;
  if (before != NULL) {
    const uint64_t place = before->address >> 1;
    struct Prediction* plain = &by_address[place % kPredictions];
    struct Prediction* deep = &by_path[(place ^ path * 0x9E3779B97F4A7C15U >> 40) % kPredictions];
    int* better = &path_is_better[place % kPredictions];
    const int plain_right = plain->block == block, deep_right = deep->block == block;
    mispredicted += !(*better > 0 ? deep_right : plain_right);
    *better += deep_right - plain_right;
    if (*better > 2 || *better < -2) *better = *better > 0 ? 2 : -2;
    learn(plain, block);
    learn(deep, block);
    path = (path << 8 | (block->address >> 2 & 0xFF)) & 0xFFFFFFFFFFFF;  // of six blocks
    int i = 0;
    while (i + 1 < kSuccessors && before->successor[i] != NULL && before->successor[i] != block) ++i;
    before->successor[i] = block;
    ++before->went[i];
  }
  before = block;
}

// Called again for a block that QEMU has forgotten.
static void on_translation(qemu_plugin_id_t id, struct qemu_plugin_tb* tb) {
  (void)id;
  const uint64_t address = qemu_plugin_tb_vaddr(tb);
  const size_t count = qemu_plugin_tb_n_insns(tb);
  char* hex = calloc(count, 32);
  for (size_t i = 0, at = 0; i < count; ++i) {
    const struct qemu_plugin_insn* insn = qemu_plugin_tb_get_insn(tb, i);
    const uint8_t* bytes = qemu_plugin_insn_data(insn);
    hex[at++] = ' ';
    for (size_t k = 0; k < qemu_plugin_insn_size(insn) && k < 15; ++k)
      at += (size_t)sprintf(hex + at, "%02x", bytes[k]);
  }
  struct Block* block = blocks;
  while (block != NULL && (block->address != address || strcmp(block->hex, hex) != 0)) block = block->next;
  if (block == NULL) {
    block = calloc(1, sizeof *block);
    *block = (struct Block){.next = blocks, .address = address, .hex = hex};
    blocks = block;
  } else {
    free(hex);
  }
  qemu_plugin_register_vcpu_tb_exec_cb(tb, on_block, QEMU_PLUGIN_CB_NO_REGS, block);
}

static void on_end(qemu_plugin_id_t id, void* data) {
  (void)id;
  (void)data;
  fprintf(out, "mispredicted %llu\n", (unsigned long long)mispredicted);
  for (const struct Block* b = blocks; b != NULL; b = b->next) {
    int most = 0;
    for (int i = 1; i < kSuccessors; ++i) most = b->went[i] > b->went[most] ? i : most;
    fprintf(out, "%llx %llu%s > %llx %llu\n", (unsigned long long)b->address, (unsigned long long)b->count, b->hex,
            b->successor[most] != NULL ? (unsigned long long)b->successor[most]->address : 0,
            (unsigned long long)b->went[most]);
  }
  fclose(out);
}

EXPORT int qemu_plugin_install(qemu_plugin_id_t id, const struct qemu_info_t* info, int argc, char** argv) {
  (void)info;
  out = argc == 1 && strncmp(argv[0], "out=", 4) == 0 ? fopen(argv[0] + 4, "w") : NULL;
  if (out == NULL) {
    fprintf(stderr, "error: no file for the blocks (no out=FILE, or it cannot be written). Next: give one\n");
    return 1;
  }
  qemu_plugin_register_vcpu_tb_trans_cb(id, on_translation);
  qemu_plugin_register_atexit_cb(id, on_end, NULL);
  return 0;
}
