# SPDX-License-Identifier: Apache-2.0
# Cross build for a 64-bit Raspberry Pi 4 with Debian's g++-aarch64-linux-gnu and that package's own C and C++
# libraries. Everything else comes from build/sysroot-aarch64 (toolchain/sysroot.sh), or from another HOLDFAST_SYSROOT, for
# another HOLDFAST_CPU (toolchain/install/deb.sh --arch). ctest runs the tests under qemu-user by itself. Units and ranges:
# none. Errors: a missing sysroot, compiler or emulator stops the configuration.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(holdfast_triplet aarch64-linux-gnu)
set(HOLDFAST_SYSROOT ${CMAKE_CURRENT_LIST_DIR}/../build/sysroot-aarch64 CACHE PATH "where the board's libraries are")
set(HOLDFAST_CPU cortex-a72 CACHE STRING "compiled for this and later ones")
list(APPEND CMAKE_TRY_COMPILE_PLATFORM_VARIABLES HOLDFAST_SYSROOT HOLDFAST_CPU)
cmake_path(NORMAL_PATH HOLDFAST_SYSROOT)

if(NOT EXISTS ${HOLDFAST_SYSROOT}/packages.txt)
  message(FATAL_ERROR "There is no sysroot at ${HOLDFAST_SYSROOT}: run toolchain/sysroot.sh first.")
endif()

set(CMAKE_C_COMPILER ${holdfast_triplet}-gcc)
set(CMAKE_CXX_COMPILER ${holdfast_triplet}-g++)
# What an attacker who finds a hole meets (tests/checks/hardening.sh looks at the binary). The return addresses' and
# jumps' protection are hints that a Cortex-A72 takes for no-ops, and later cores obey.
set(holdfast_hardening
  "-D_FORTIFY_SOURCE=2 -fstack-protector-strong -fstack-clash-protection -mbranch-protection=standard -fPIE")
set(CMAKE_C_FLAGS_INIT "-mcpu=${HOLDFAST_CPU} ${holdfast_hardening}")
set(CMAKE_CXX_FLAGS_INIT "-mcpu=${HOLDFAST_CPU} ${holdfast_hardening}")
set(CMAKE_EXE_LINKER_FLAGS_INIT "-pie -Wl,-z,relro,-z,now,-z,noexecstack")
set(CMAKE_LIBRARY_ARCHITECTURE ${holdfast_triplet})
# Debian's headers of one architecture (libjpeg's configuration): only a compiler at home there looks for them itself.
set(CMAKE_CXX_STANDARD_INCLUDE_DIRECTORIES ${HOLDFAST_SYSROOT}/usr/include/${holdfast_triplet})

# Not CMAKE_SYSROOT: libc and libstdc++ are the cross packages' (/usr/${holdfast_triplet}), which gcc knows by itself.
set(CMAKE_FIND_ROOT_PATH ${HOLDFAST_SYSROOT} /usr/${holdfast_triplet})
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE ONLY)
set(ENV{PKG_CONFIG_PATH} "")
set(ENV{PKG_CONFIG_LIBDIR} ${HOLDFAST_SYSROOT}/usr/lib/${holdfast_triplet}/pkgconfig:${HOLDFAST_SYSROOT}/usr/share/pkgconfig)
set(ENV{PKG_CONFIG_SYSROOT_DIR} ${HOLDFAST_SYSROOT})

# qemu-aarch64 (package qemu-user) also takes plugins, which the instruction count needs; the static one does not.
find_program(HOLDFAST_QEMU NAMES qemu-aarch64 qemu-aarch64-static REQUIRED)
# Libraries of the sysroot depend on others of it, which RUNPATH does not say.
set(holdfast_libraries ${HOLDFAST_SYSROOT}/usr/lib/${holdfast_triplet}:${HOLDFAST_SYSROOT}/lib/${holdfast_triplet})
string(APPEND CMAKE_EXE_LINKER_FLAGS_INIT " -Wl,-rpath-link,${holdfast_libraries}")
set(CMAKE_CROSSCOMPILING_EMULATOR
  ${HOLDFAST_QEMU} -L /usr/${holdfast_triplet} -E LD_LIBRARY_PATH=/usr/${holdfast_triplet}/lib:${holdfast_libraries})
