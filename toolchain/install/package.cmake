# SPDX-License-Identifier: Apache-2.0
# The host tool as a Debian package: `cpack --config build/sim/CPackConfig.cmake` (toolchain/install/deb.sh does all of
# it). Component `pc`; the boards have components of their own (board/CMakeLists.txt).
include(GNUInstallDirs)
set(pages ${PROJECT_BINARY_DIR}/man)
set(packaged holdfast holdfastd)
if(TARGET holdfast-sensor)
  list(APPEND packaged holdfast-sensor)
endif()
add_custom_target(man_pages
  COMMAND ${PROJECT_SOURCE_DIR}/toolchain/install/man_pages.sh ${CMAKE_RUNTIME_OUTPUT_DIRECTORY} ${pages}
  DEPENDS ${packaged}
  VERBATIM)
install(TARGETS ${packaged} DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT pc)
# Where drivers/sim/media.cpp looks; a folder less deep, and CPack has the package call ldconfig, which lintian warns of.
install(TARGETS holdfast_media LIBRARY DESTINATION lib/holdfast/modules COMPONENT pc)
install(DIRECTORY ${pages}/ DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT pc FILES_MATCHING PATTERN "*.1.gz")
install(FILES toolchain/install/holdfast.bash
  DESTINATION share/bash-completion/completions RENAME holdfast COMPONENT pc)
install(DIRECTORY tests/scenes/ DESTINATION share/holdfast/scenes COMPONENT pc FILES_MATCHING PATTERN "*.json")
install(FILES toolchain/install/60-holdfast.rules DESTINATION lib/udev/rules.d COMPONENT pc)
install(FILES toolchain/install/copyright ${pages}/changelog.gz DESTINATION share/doc/holdfast COMPONENT pc)

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME holdfast)
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_PACKAGE_CONTACT "Holdfast contributors <holdfast@users.noreply.github.com>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "sense of slip for robot grippers with a GelSight Mini")
set(CPACK_DEBIAN_PACKAGE_DESCRIPTION
"The host tool of the Holdfast firmware: shows the sensor on this computer in
the browser, records it, runs the firmware on recordings and on simulated
grasps, talks to a board, and learns from labelled recordings. With it comes
the firmware itself as a process, on simulated lines.

It is not a safety function.")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_ALL pc)
set(CPACK_DEBIAN_PC_PACKAGE_NAME holdfast)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
if(NOT CPACK_DEBIAN_PC_PACKAGE_DEPENDS)  # given by deb.sh --arch: dpkg-shlibdeps knows the packages of this machine alone
  set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
endif()
set(CPACK_STRIP_FILES ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE
  WORLD_READ WORLD_EXECUTE)
include(CPack)
