// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cctype>
#include <set>
#include <string>

namespace citylearn {

/// Returns a text as a part of a topic's name in ROS 2: with '_' for what it may not have, `prefix` where it would not
/// begin with a letter (a leading '_' would hide the topic, a leading digit is not allowed), and a number behind what
/// is `taken`. Adds it to these.
inline std::string ros2_name(std::string text, const std::string& prefix, std::set<std::string>& taken) {
  for (char& letter : text)
    if (!std::isalnum(static_cast<unsigned char>(letter))) letter = '_';
  if (text.empty() || !std::isalpha(static_cast<unsigned char>(text.front()))) text = prefix + text;
  std::string unique = text;
  for (int number = 2; !taken.insert(unique).second; ++number) unique = text + "_" + std::to_string(number);
  return unique;
}

}  // namespace citylearn
