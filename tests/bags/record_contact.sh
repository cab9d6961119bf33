#!/usr/bin/env bash
# Records tests/bags/contact.bag: .ci/in_ros tests/bags/record_contact.sh
#
# The piston cell locates its displaced block, takes the piston, and inserts it twice: first with a force limit that the
# weight of the piston almost reaches. Kept are the images and transforms of the two views, and the state of the arm
# during the second insertion; their times are those of the recorded run.
set -euo pipefail
here=$(dirname "$(realpath "$0")")
if [ "${1:-}" = run ]; then
  rosservice call /sim/set_pose "{element: 'piston:EngineBlock-11', pose: {header: {frame_id: map}, pose: {
    position: {x: 0.0021, y: -0.0021, z: 0.15}, orientation: {z: 0.0174524, w: 0.9998477}}}}"
  insert=(insert_into_bore "Arm=Right arm" Part=Piston "Bore=Bore 2")
  rosrun skiros2_skill run locate_part "Object=Engine block"
  rosrun skiros2_skill run take_part Part=Piston
  rosrun skiros2_skill run "${insert[@]}" MaxForce=5.0 || true
  rosrun skiros2_skill run "${insert[@]}"
  exit
fi
whole=$(mktemp --suffix .bag)
trap 'rm -f "$whole"' EXIT
ROBOT=piston_cell ALSO='/piston_cell/camera/depth/.*|.*/right_compliant/state' \
  WITHOUT='/rosout.*|/sim/contacts|/piston_cell/execute/feedback|/piston_cell/joint_states' \
  "$here/record.sh" "$whole" "skiros2_contact_skills piston.launch gui:=false" "$here/record_contact.sh" run
rosbag filter "$whole" "$here/contact.bag" '(
    topic in ("/clock", "/wm/monitor", "/piston_cell/monitor", "/piston_cell/right_arm/wrist/wrench", "/recorder/parameters")
    or topic.startswith(("/piston_cell/execute/", "/piston_cell/right_gripper/"))
    or topic.startswith(("/piston_cell/right_arm/follow_joint_trajectory/", "/piston_cell/right_arm/plan_motion/"))
    or topic.endswith("/right_compliant/state") and m.header.stamp.to_sec() > 33.8
    or "/camera/depth/" in topic and round(m.header.stamp.to_sec(), 2) in (5.5, 9.0)
    or topic == "/tf" and any(abs(m.transforms[0].header.stamp.to_sec() - at) < 0.05 for at in (5.5, 9.0)))'
rosbag compress -f --bz2 "$here/contact.bag"
rm -f "$here/contact.orig.bag"
