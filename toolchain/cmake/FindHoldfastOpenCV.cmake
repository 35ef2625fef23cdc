# SPDX-License-Identifier: Apache-2.0
# The OpenCV modules that Holdfast's host side uses, as imported targets (so their headers are system headers):
#   holdfast::opencv       core imgproc                          (pictures; required)
#   holdfast::opencv_media core imgcodecs videoio                (foreign formats, drivers/sim/media.hpp; required)
#   holdfast::opencv_ml    core and ml                              (training; required)
#   holdfast::opencv_all   all but those of foreign formats      (rivals in `holdfast trade`, test oracles; required)
# Debian's libopencv-*-dev packages ship neither OpenCVConfig.cmake nor opencv4.pc; both are in the libopencv-dev
# metapackage, which pulls in every module there is.
include(FindPackageHandleStandardArgs)

find_path(HoldfastOpenCV_INCLUDE_DIR opencv2/core.hpp PATH_SUFFIXES opencv4)
set(holdfast_opencv_modules core imgproc imgcodecs videoio ml features2d video)
foreach(module IN LISTS holdfast_opencv_modules)
  find_library(HoldfastOpenCV_${module}_LIBRARY opencv_${module})
  mark_as_advanced(HoldfastOpenCV_${module}_LIBRARY)
endforeach()
mark_as_advanced(HoldfastOpenCV_INCLUDE_DIR)

list(TRANSFORM holdfast_opencv_modules REPLACE "(.+)" "HoldfastOpenCV_\\1_LIBRARY" OUTPUT_VARIABLE holdfast_opencv_libraries)
find_package_handle_standard_args(HoldfastOpenCV
  REQUIRED_VARS HoldfastOpenCV_INCLUDE_DIR ${holdfast_opencv_libraries}
  REASON_FAILURE_MESSAGE "Install libopencv-{core,imgproc,imgcodecs,videoio,ml,features2d,video}-dev (toolchain/packages.sh lists all packages).")

# holdfast_opencv_target(NAME MODULE...): one interface target over the modules, when all of them are there.
function(holdfast_opencv_target name)
  if(TARGET ${name})
    return()
  endif()
  set(libraries "")
  foreach(module IN LISTS ARGN)
    if(NOT HoldfastOpenCV_${module}_LIBRARY)
      return()
    endif()
    list(APPEND libraries ${HoldfastOpenCV_${module}_LIBRARY})
  endforeach()
  add_library(${name} INTERFACE IMPORTED)
  set_target_properties(${name} PROPERTIES
    INTERFACE_INCLUDE_DIRECTORIES ${HoldfastOpenCV_INCLUDE_DIR}
    INTERFACE_LINK_LIBRARIES "${libraries}")
endfunction()

if(HoldfastOpenCV_FOUND)
  holdfast_opencv_target(holdfast::opencv core imgproc)
  holdfast_opencv_target(holdfast::opencv_media core imgcodecs videoio)
  holdfast_opencv_target(holdfast::opencv_ml core ml)
  holdfast_opencv_target(holdfast::opencv_all core imgproc ml features2d video)
endif()
