# Debian packages by `cpack`, and what they bring besides programs and libraries: a manual page for every command and the completion of
# bash, both made from the program itself when packages are made.
#   kincal         the program
#   kincal-images  kincal-detect, kincal-render and kincal-bags: what needs OpenCV, so that kincal stays small
#   libkincal-dev  static libraries, headers and the CMake package
#   libkincal0     the library of kincal.h
#   python3-kincal the Python package
find_program(KINCAL_PYTHON3 python3)
mark_as_advanced(KINCAL_PYTHON3)
set(documents ${PROJECT_BINARY_DIR}/documents)

# Documents of programs, made when `component` is installed. A program for another kind of machine cannot be asked.
function(kincal_documents component)
  if(CMAKE_CROSSCOMPILING OR NOT KINCAL_PYTHON3)
    message(STATUS "Manual pages and completion are left out: they need python3 and a program that runs here")
    return()
  endif()
  set(programs "")
  foreach(target ${ARGN})
    list(APPEND programs $<TARGET_FILE:${target}>)
  endforeach()
  install(CODE "
    execute_process(COMMAND ${KINCAL_PYTHON3} \"${PROJECT_SOURCE_DIR}/scripts/program-documents\" \"${documents}/${component}\" ${PROJECT_VERSION} ${programs}
      COMMAND_ERROR_IS_FATAL ANY)" COMPONENT ${component})
  install(DIRECTORY ${documents}/${component}/man1 DESTINATION ${CMAKE_INSTALL_MANDIR} COMPONENT ${component})
  install(DIRECTORY ${documents}/${component}/completions DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion COMPONENT ${component} OPTIONAL)
endfunction()

kincal_documents(kincal kincal)
install(FILES LICENSE RENAME copyright DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/kincal COMPONENT kincal)
install(FILES CHANGELOG.md DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/kincal COMPONENT kincal)
install(FILES LICENSE RENAME copyright DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/libkincal-dev COMPONENT kincal_solver)
set(CPACK_COMPONENTS_ALL kincal kincal_kinematics kincal_solver kincal_core kincal_models kincal_io)
set(image_programs "")
foreach(target kincal-detect kincal-render kincal-bags)
  if(TARGET ${target})
    list(APPEND image_programs ${target})
  endif()
endforeach()
if(image_programs)
  list(REMOVE_ITEM image_programs kincal-detect)  # kincal-detect(1) is the page of `kincal detect`, which is the same
  kincal_documents(kincal_images ${image_programs})
  install(FILES LICENSE RENAME copyright DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/kincal-images COMPONENT kincal_images)
  list(APPEND CPACK_COMPONENTS_ALL kincal_images)
endif()

if(TARGET kincal_c)
  install(FILES LICENSE RENAME copyright DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/libkincal0 COMPONENT kincal_c_library)
  list(APPEND CPACK_COMPONENTS_ALL kincal_c kincal_c_library)
endif()

if(TARGET kincal_python)
  install(FILES LICENSE RENAME copyright DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/python3-kincal COMPONENT kincal_python)
  list(APPEND CPACK_COMPONENTS_ALL kincal_python)
endif()

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME kincal)
set(CPACK_PACKAGE_CONTACT "the kincal authors <kincal@users.noreply.github.com>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "calibration of robots by bundle adjustment over kinematic chains")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)

set(CPACK_DEBIAN_PROGRAM_PACKAGE_NAME kincal)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SHLIBDEPS ON)
if(KINCAL_CHOLMOD)
  set(CPACK_DEBIAN_PROGRAM_PACKAGE_DEPENDS libcholmod3)  # loaded when it is needed, which shlibdeps does not see
endif()
set(CPACK_DEBIAN_PROGRAM_PACKAGE_RECOMMENDS "kincal-images (= ${PROJECT_VERSION})")
set(CPACK_COMPONENT_PROGRAM_DESCRIPTION "From a URDF and logged samples of cameras, lasers, trackers and joints it
finds joint offsets, gears, mounts, intrinsics, baselines and target poses.")

set(CPACK_DEBIAN_IMAGES_PACKAGE_NAME kincal-images)
set(CPACK_DEBIAN_IMAGES_PACKAGE_SECTION science)
set(CPACK_DEBIAN_IMAGES_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_IMAGES_PACKAGE_DEPENDS "kincal (= ${PROJECT_VERSION})")
set(CPACK_COMPONENT_IMAGES_DESCRIPTION "The commands detect, import of bags, and simulate --render of kincal.")

set(CPACK_DEBIAN_DEV_PACKAGE_NAME libkincal-dev)
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
# The headers need Eigen; the CMake package finds the others, to be linked.
set(dev_depends "libeigen3-dev (>= 3.4)")
if(KINCAL_CHOLMOD)
  string(APPEND dev_depends ", libsuitesparse-dev")
endif()
if(KINCAL_IO)
  string(APPEND dev_depends ", libpugixml-dev, libyaml-cpp-dev, nlohmann-json3-dev, liburdfdom-dev, nettle-dev, pkg-config")
endif()
if(TARGET kincal_c)
  string(APPEND dev_depends ", libkincal0 (= ${PROJECT_VERSION})")
endif()
set(CPACK_DEBIAN_DEV_PACKAGE_DEPENDS "${dev_depends}")
set(CPACK_COMPONENT_DEV_DESCRIPTION "Static libraries and headers: find_package(kincal) and link kincal::models or kincal::io.")

if(TARGET kincal_c)
  set(CPACK_DEBIAN_LIBRARY_PACKAGE_NAME libkincal0)
  set(CPACK_DEBIAN_LIBRARY_PACKAGE_SECTION libs)
  set(CPACK_DEBIAN_LIBRARY_PACKAGE_SHLIBDEPS ON)
  set(CPACK_DEBIAN_PACKAGE_GENERATE_SHLIBS ON)  # and the trigger of ldconfig
  if(KINCAL_CHOLMOD)
    set(CPACK_DEBIAN_LIBRARY_PACKAGE_DEPENDS libcholmod3)
  endif()
  set(CPACK_COMPONENT_LIBRARY_DESCRIPTION "The library of kincal.h: calibrate, evaluate and watch robots from C.")
endif()

if(TARGET kincal_python)
  # The module is for one version of Python, as its name says.
  set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-kincal)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_SHLIBDEPS ON)
  get_directory_property(python_minor DIRECTORY ${PROJECT_SOURCE_DIR}/bindings/python DEFINITION Python3_VERSION_MINOR)
  math(EXPR next_python "${python_minor} + 1")
  set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS "python3 (>= 3.${python_minor}), python3 (<< 3.${next_python}), python3-numpy")
  if(KINCAL_CHOLMOD)
    string(APPEND CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS ", libcholmod3")
  endif()
  set(CPACK_DEBIAN_PYTHON_PACKAGE_SUGGESTS "kincal-images, python3-pandas")
  set(CPACK_COMPONENT_PYTHON_DESCRIPTION "The Python package kincal: calibrate, check, evaluate and simulate with dicts and arrays.")
endif()

include(CPack)
cpack_add_component_group(PROGRAM)
cpack_add_component_group(IMAGES)
cpack_add_component_group(DEV)
cpack_add_component_group(PYTHON)
cpack_add_component_group(LIBRARY)
cpack_add_component(kincal GROUP PROGRAM)
cpack_add_component(kincal_images GROUP IMAGES)
cpack_add_component(kincal_python GROUP PYTHON)
cpack_add_component(kincal_c_library GROUP LIBRARY)
cpack_add_component(kincal_c GROUP DEV)
foreach(library kinematics solver core models io)
  cpack_add_component(kincal_${library} GROUP DEV)
endforeach()
