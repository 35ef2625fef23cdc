# SPDX-License-Identifier: Apache-2.0
# What U-Boot does at each start, on every board: takes the first slot of BOOT_ORDER that has attempts left, counts one
# off and writes that down before it starts anything, so that a slot that hangs, resets or loses its power has had its
# attempt. RAUC sets the same variables from Linux (its U-Boot backend, by /etc/fw_env.config), and marking a slot good
# gives it its three attempts back.
# The variables are one sector of 512 bytes in the partition env: a sector is written or it is not. U-Boot's own
# environment, which would be a file on a FAT, is never written.
# Given: devtype, devnum (where this script came from); by build.sh board_words, kernel_at, ramdisk_at, words_at; more_words,
# if uboot.env has any; and fdtcontroladdr, U-Boot's own copy of the device tree that it was started with: what a first
# stage left may lie where the initrd goes.

part start ${devtype} ${devnum} env env_at
setenv known 0
if ${devtype} read ${words_at} ${env_at} 1; then
  if env import -c ${words_at} 0x200 BOOT_ORDER BOOT_A_LEFT BOOT_B_LEFT BOOT_TRIAL; then setenv known 1; fi
fi
if test ${known} = 0; then
  echo "holdfast: the boot counters were damaged: both slots get three attempts"
  setenv BOOT_ORDER "A B"; setenv BOOT_A_LEFT 3; setenv BOOT_B_LEFT 3; setenv BOOT_TRIAL
fi

setenv slot
for candidate in ${BOOT_ORDER}; do
  if test -z "${slot}" -a "${candidate}" = A -a "${BOOT_A_LEFT}" -gt 0; then
    setenv slot a; setexpr BOOT_A_LEFT ${BOOT_A_LEFT} - 1
  fi
  if test -z "${slot}" -a "${candidate}" = B -a "${BOOT_B_LEFT}" -gt 0; then
    setenv slot b; setexpr BOOT_B_LEFT ${BOOT_B_LEFT} - 1
  fi
done
if test -z "${slot}"; then
  # Whatever was wrong may have been the power: a machine that starts nothing helps nobody.
  echo "holdfast: no slot has attempts left: both get three more"
  setenv BOOT_ORDER "A B"; setenv BOOT_A_LEFT 3; setenv BOOT_B_LEFT 3
fi
env export -c -s 0x200 ${words_at} BOOT_ORDER BOOT_A_LEFT BOOT_B_LEFT BOOT_TRIAL
${devtype} write ${words_at} ${env_at} 1

if test -n "${slot}"; then
  if test "${slot}" = a; then setenv name A; else setenv name B; fi
  echo "holdfast: slot ${name}"
  part number ${devtype} ${devnum} kernel-${slot} number
  if load ${devtype} ${devnum}:${number} ${words_at} slot.env; then
    env import -t ${words_at} ${filesize} slot_words
    if load ${devtype} ${devnum}:${number} ${kernel_at} vmlinuz; then
      if load ${devtype} ${devnum}:${number} ${ramdisk_at} initrd.gz; then
        setenv bootargs "${board_words} ${more_words} holdfast.slot=${slot} rauc.slot=${name} ${slot_words}"
        booti ${kernel_at} ${ramdisk_at}:${filesize} ${fdtcontroladdr}
      fi
    fi
  fi
  echo "holdfast: slot ${name} does not start"
fi
reset
