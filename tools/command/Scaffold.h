#pragma once

#include <filesystem>
#include <map>
#include <string>

namespace viable {

/** A folder that `viable new` is about to write: path inside the folder, text. */
using FolderFiles = std::map<std::string, std::string>;

/** The folder of this program's templates. */
std::filesystem::path getTemplates();
/** This program's file. */
std::filesystem::path getProgram();
/** How the user starts this program: `viable` where the PATH leads to it. */
std::string getProgramWord();
/** The path as a user in the current folder would write it. */
std::string showPath(const std::filesystem::path& path);

/** Throws Error (BadInput) unless `name` is snake_case, at most 60 characters and usable for files, CMake targets and
(with `isClass`) a C++ class; the message holds a spelling that is.
@param kind  what is named, a word of the command line, for the message */
void checkNewName(const std::string& name, const std::string& kind, bool isClass);

/** "my_filter" -> "MyFilter". */
std::string makeClassName(const std::string& name);

/** The files of a template folder. `replacements`: @KEY@ in texts and in file names. A file called Plugin* is called
CLASS* instead when there is a replacement for CLASS. Throws Error when the folder cannot be read. */
FolderFiles fillTemplate(const std::filesystem::path& folder, const std::map<std::string, std::string>& replacements);

/** Throws Error (BadInput) where `target` is a file or a folder that is not empty. */
void checkNewFolder(const std::filesystem::path& target);

/** Writes all files or none: into a folder beside `target` first, which then takes its name. Missing folders above are
made. Throws Error (BadInput). */
void writeNewFolder(const std::filesystem::path& target, const FolderFiles& files);

}  // namespace viable
